// @ts-check
/** Before and after: side by side, by a slider, or while a key is held. Before is the asset, or any shape that it has had. */
import { isAbort } from "../client.js";
import { button, fill, h, options } from "../dom.js";
import { saveBytes } from "../job/files.js";
import { choose, segmented, slider, toggle } from "../widgets.js";
import { orToast } from "../problem-box.js";
import { linkViews, ViewerBox } from "../viewer-box.js";

/** @typedef {import("./live.js").Shape} Shape */
/** @typedef {"none" | "wipe" | "beside"} Way */

const WAYS = /** @type {[Way, string][]} */ ([["none", "Result"], ["wipe", "Before | after"], ["beside", "Side by side"]]);
const KEY = "b";

export class Comparison {
  /** @param {import("./asset-panel.js").AssetPanel} assets @param {import("../scope.js").Scope} scope */
  constructor(assets, scope) {
    this.assets = assets;
    this.scope = scope;
    this.way = /** @type {Way} */ ("none");
    /** What stands on the side of before; null: the asset. @type {Shape | null} */
    this.before = null;
    /** What is loaded there: the asset, and the shape that it has. */
    this.loaded = "";
    /** @type {Shape[]} */
    this.shapes = [];
    /** Whether there is an after. */
    this.on = false;
    /** Whether the button or the key is held. */
    this.held = false;
    this.box = new ViewerBox("Before", scope);
    this.side = h("div", { class: "before", hidden: true }, this.box.element);
    this.ways = segmented("Compare", WAYS, "none", (way) => this._choose(/** @type {Way} */ (way)));
    const { input, row } = slider("wipe-slider", "Before and after", 100, () => this._wipe());
    input.value = "50";
    this.input = input;
    this.wipe = row;
    this.wipe.classList.add("wipe-row");
    this.wipe.hidden = true;
    this.with = h("select", { class: "select-small", "aria-label": "Compare with", on: { change: () => this._with(this.with.value) } });
    this.hold = button("Hold for before", () => {}, { title: `See it as it was (key ${KEY.toUpperCase()})` });
    this.element = h("div", { class: "row compare-tools", hidden: true }, this.ways, this.hold, this.with);
    this.view = this._view();
    assets.stage.append(this.wipe);
    this._holds();
    linkViews(assets.box, this.box);
  }

  /** What shows the edges, and what saves pictures. */
  _view() {
    const { box } = this.assets;
    const wires = toggle("Wireframe", (on) => [box, this.box].forEach(({ viewer }) => viewer?.setWireframe(on)));
    const picture = button("Save picture", () => orToast("No picture", async () => saveBytes(await box.picture(), "shape.png")), { icon: "camera", class: "button-quiet" });
    return h("div", { class: "row stage-tools", role: "group", "aria-label": "View" }, wires, picture);
  }

  /** @param {boolean} on Whether the view shows a shape to compare. */
  offer(on) {
    this.on = on;
    this.element.hidden = !on;
    this._draw();
  }

  /** @param {Shape[]} shapes That may stand on the side of before. */
  choices(shapes) {
    this.shapes = shapes;
    const chosen = this.before?.key ?? "";
    fill(this.with, options([["", "with your asset"], ...shapes.map(({ key, label }, i) => /** @type {[string, string]} */ ([key, `with ${i + 1} · ${label}`]))]));
    this.with.hidden = shapes.length < 2;
    this.with.value = chosen;
    if (this.with.value !== chosen) this._with("");
  }

  /** Compare with a shape, and show both. @param {Shape} shape */
  against(shape) {
    this.before = shape;
    this.choices(this.shapes);
    this._choose("beside");
  }

  /** @param {string} key */
  _with(key) {
    this.before = this.shapes.find((shape) => shape.key === key) ?? null;
    this.with.value = key;
    this._draw();
  }

  /** @param {Way} way */
  _choose(way) {
    this.way = way;
    choose(this.ways, way);
    this._draw();
  }

  _wipe() {
    this.assets.stage.style.setProperty("--wipe", `${this.input.value}%`);
    this.input.setAttribute("aria-valuetext", `${this.input.value} percent before`);
  }

  /** Before is seen while its button or key is held. */
  _holds() {
    const press = (/** @type {boolean} */ on) => () => this._held(on);
    const { hold, scope } = this;
    for (const [type, on] of /** @type {[string, boolean][]} */ ([["pointerdown", true], ["pointerup", false], ["pointerleave", false], ["pointercancel", false], ["blur", false]])) hold.addEventListener(type, press(on));
    const keys = (/** @type {boolean} */ on) => (/** @type {KeyboardEvent} */ event) => {
      const typing = event.target instanceof Element && event.target.matches("input:not([type=range]):not([type=radio]):not([type=checkbox]), textarea, select");
      const own = event.target === hold && [" ", "Enter"].includes(event.key);
      const key = event.key.toLowerCase() === KEY && !typing && !event.ctrlKey && !event.metaKey && !event.altKey;
      if (own) event.preventDefault();
      if ((own || key) && !event.repeat) this._held(on);
    };
    scope.listen(document, "keydown", keys(true));
    scope.listen(document, "keyup", keys(false));
  }

  /** @param {boolean} on */
  async _held(on) {
    if (on && !this.on) return;
    this.hold.setAttribute("aria-pressed", String(on));
    this.held = on;
    await this._draw();
  }

  /** Show what is chosen. */
  async _draw() {
    const { stage } = this.assets;
    const seen = this.held ? "hold" : this.on ? this.way : "none";
    stage.dataset.compare = seen;
    this.side.hidden = seen === "none";
    this.wipe.hidden = seen !== "wipe";
    if (seen === "wipe") this._wipe();
    if (seen !== "none" && !this.side.isConnected) this.wipe.before(this.side);
    if (seen !== "none") await this._load();
  }

  async _load() {
    const asset = this.assets.shown;
    const { before } = this;
    const key = JSON.stringify([this.assets.choices, before?.key]);
    if (!asset || key === this.loaded) return;
    this.loaded = key;
    this.box.tag.textContent = before ? `Before: ${before.label}` : "Before";
    try {
      await this.box.load(await asset.bytes(), asset.format, true);
      if (before && this.loaded === key && (await this.box.deform(await before.load()))) this.box.viewer?.setMorph(1);
    } catch (error) {
      if (this.loaded === key) this.loaded = "";
      if (!isAbort(error)) this.box.say("This shape could not be loaded", "", "warn", true);
    }
  }
}
