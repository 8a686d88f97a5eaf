// @ts-check
/** The target beside the asset, and pairs of points that are clicked, one on each. */
import { fill, h } from "../../dom.js";
import { rounded } from "../control/rows.js";
import { Scope } from "../../scope.js";
import { ViewerBox } from "../../viewer-box.js";

export class TargetView {
  /**
   * @param {import("../asset-panel.js").AssetPanel} assets
   * @param {import("../control/view.js").ControlView} control Points at the asset.
   * @param {import("../../scope.js").Scope} scope
   * @param {import("./panel.js").GuidePanel} panel
   */
  constructor(assets, control, scope, panel) {
    this.assets = assets;
    this.control = control;
    this.scope = scope;
    this.panel = panel;
    /** @type {ViewerBox | null} */
    this.box = null;
    /** Of the view of one target. @type {Scope | null} */
    this.own = null;
    /** @type {import("../../../viewer/control/tools.js").ControlTools | null} */
    this.tools = null;
    this.size = 1;
    this.pairing = false;
    /** The half of a pair that was clicked. @type {{source?: number[], target?: number[]}} */
    this.half = {};
    this.hint = h("p", { class: "small muted", "aria-live": "polite", hidden: true });
    scope.add(() => this.own?.dispose());
  }

  /** Whether there is something to click on. */
  get possible() {
    return Boolean(this.control.possible && this.box?.viewer?.ready);
  }

  /** A first pair, to be typed over: the tops of both. */
  get places() {
    const box = this.box?.viewer?.ready ? this.box.viewer.ownBox : null;
    const top = box ? rounded([(box.min.x + box.max.x) / 2, box.max.y, (box.min.z + box.max.z) / 2], this.size) : [0, 1, 0];
    return { source: this.control.top, target: top };
  }

  /** @param {import("../../assets.js").Asset | null} target */
  async show(target) {
    this.pair(false);
    this.own?.dispose();
    this.own = null;
    this.tools = null;
    this.box?.element.remove();
    this.box = null;
    this.assets.stage.classList.toggle("with-target", target !== null);
    this.assets.box.tag.hidden = target === null;
    if (!target) return;
    const own = new Scope();
    this.own = own;
    const box = new ViewerBox("Target", own);
    this.box = box;
    this.assets.besides(box);
    await box.load(await target.bytes(), target.format);
    if (own.over || this.scope.over) return;
    this.panel._show();
  }

  /** Let points be clicked, or no more. @param {boolean} on */
  pair(on) {
    if (this.pairing === on) return;
    this.pairing = on;
    this.half = {};
    this.control.point(on ? (place) => this._pointed("source", place) : null, () => this.pair(false));
    if (on && !this.tools) this._begin();
    this.tools?.use(on ? "point" : "turn");
    this._say();
    this.panel._show();
  }

  async _begin() {
    const { box, own } = this;
    const [{ ControlTools }, { numberedSurface }] = await Promise.all([import("../../../viewer/control/tools.js"), import("../../../viewer/control/surface.js")]);
    if (!box?.viewer?.root || !own || own.over || this.tools) return;
    this.tools = new ControlTools(box.viewer, { pointed: (place) => this._pointed("target", rounded(place, this.size)) });
    const { tools } = this;
    own.add(() => tools.dispose());
    tools.setSurface(numberedSurface(box.viewer.root));
    this.size = tools.overlay.diagonal;
    tools.use(this.pairing ? "point" : "turn");
    this.draw();
  }

  /** @param {"source" | "target"} side @param {number[]} place */
  _pointed(side, place) {
    this.half[side] = place;
    const { source, target } = this.half;
    if (source && target) {
      this.half = {};
      this.panel.addPair({ source, target });
    }
    this._say();
    this.draw();
  }

  _say() {
    this.hint.hidden = !this.pairing;
    const { source, target } = this.half;
    fill(this.hint, source ? "Now click its place on the target." : target ? "Now click its place on the asset." : "Click a point on the asset, and its place on the target.");
  }

  /** Show the points. */
  draw() {
    const { pairs } = this.panel;
    const points = (/** @type {"source" | "target"} */ side) => /** @type {any[]} */ ([...pairs.map((pair) => pair[side]), this.half[side]].filter(Array.isArray));
    this.control.extra = points("source");
    this.control.draw();
    if (this.tools) this.tools.showMarks(null, [], -1, points("target"));
    else if (pairs.length && this.box?.viewer?.ready) this._begin();
  }
}
