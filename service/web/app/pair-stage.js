// @ts-check
/** Two shapes side by side in 3D: cameras that move together, what differs as colours, and wireframe. */
import { button, h } from "./dom.js";
import { drawnPicture, segmented, showLegend, toggle } from "./job/stage-controls.js";
import { linkViews, movingControls, ViewerBox } from "./viewer-box.js";

/** @typedef {"none" | "displacement" | "stretch" | "texture"} Colour */

/** How a shape can be coloured. @type {[Colour, string][]} */
export const COLOURS = [["none", "Material"], ["displacement", "Displacement"], ["stretch", "Stretch"], ["texture", "Texture"]];

export class PairStage {
  /**
   * @param {import("./scope.js").Scope} scope
   * @param {object} words
   * @param {string} words.label Of the whole, for people who do not see it.
   * @param {[string, string]} words.tags What each view shows.
   * @param {[Colour, string][]} words.colours Those that are offered where the shapes have the same triangles.
   * @param {boolean} [words.always] Whether both are always shown; otherwise the second alone where there is little room.
   */
  constructor(scope, { label, tags, colours, always = false }) {
    this.scope = scope;
    this.views = tags.map((tag) => new ViewerBox(tag, scope));
    /** Whether the second shape has the triangles of the first. */
    this.comparable = false;
    this.kind = /** @type {Colour} */ ("none");
    this.legend = h("div", { class: "legend", hidden: true });
    this.colours = segmented("Colour", colours, "none", (kind) => this.colour(/** @type {Colour} */ (kind)));
    this.colours.hidden = true;
    /** Nothing can be drawn here. */
    this.flat = false;
    this.element = this._build(label, always);
    linkViews(this.views[0], this.views[1]);
  }

  /** @param {string} label @param {boolean} always */
  _build(label, always) {
    const wireframe = toggle("Wireframe", (on) => this.views.forEach(({ viewer }) => viewer?.setWireframe(on)));
    this.both = toggle("Side by side", (on) => this.element.classList.toggle("single", !on));
    const wide = always || window.matchMedia("(min-width: 700px)").matches;
    this.both.hidden = always;
    this.both.setAttribute("aria-pressed", String(wide));
    const reset = button("Reset view", () => this.views.forEach((view) => view.resetView()), { icon: "reset", quiet: true, class: "button-quiet" });
    this.tools = h("div", { class: "row stage-tools" }, this.colours, wireframe, this.both, reset);
    return h(
      "section",
      { class: wide ? "job-stage" : "job-stage single", "aria-label": label },
      h("div", { class: "stage pair-stage" }, this.views.map(({ element }) => element), this.legend),
      movingControls(this.scope, this.views, (ending) => this.turntableName(ending)),
      this.tools,
    );
  }

  /** What a turntable of the second view is saved as. @param {string} ending */
  turntableName(ending) {
    return `turntable.${ending}`;
  }

  /**
   * Show a GLB, and another one, which may be the first in another shape.
   * @param {ArrayBuffer} first
   * @param {ArrayBuffer} second
   * @param {boolean} [apart] Whether they are of different assets: each is shown as it is then.
   * @returns {Promise<boolean>} Whether the second has the triangles of the first.
   */
  async show(first, second, apart = false) {
    const [one, other] = this.views;
    // Each viewer has a copy: what it reads it may keep.
    const found = await Promise.all([one.load(first.slice(0), "glb"), other.load((apart ? second : first).slice(0), "glb")]);
    this.flat = found.includes(null);
    this.element.classList.toggle("flat", this.flat);
    this.comparable = !apart && found.every(Boolean) && (await other.deform(second.slice(0)));
    if (this.scope.over) return false;
    this.colours.hidden = !this.comparable;
    if (this.comparable) {
      other.viewer?.setMorph(1);
      this.colour(this.kind);
    }
    return this.comparable;
  }

  /** Show the picture that a job made, where nothing can be drawn. @param {Blob} picture */
  showPicture(picture) {
    this.element.querySelector(".stage")?.append(drawnPicture(this.scope, picture, "Before, above, and after, below, from four sides"));
  }

  /** @param {Colour} kind */
  colour(kind) {
    this.kind = kind;
    showLegend(this.legend, this.comparable || kind === "none" ? this.views[1].heatmap(kind) : null);
  }
}
