// @ts-check
/** Two shapes side by side in 3D: cameras that move together, what differs as colours, and wireframe. */
import { button, h } from "./dom.js";
import { drawnPicture, segmented, showLegend, toggle } from "./job/stage-controls.js";
import { linkViews, ViewerBox } from "./viewer-box.js";

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
    /** Whether the second file may have other materials than the first. */
    this.apart = false;
    /** @type {ArrayBuffer[]} */
    this.files = [];
    this.work = Promise.resolve();
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
      this.tools,
    );
  }

  /**
   * Show a GLB, and another one, which may be the first in another shape.
   * @param {ArrayBuffer} first
   * @param {ArrayBuffer} second
   * @param {{apart?: boolean}} [options] `apart`: the second may have other materials than the first.
   * @returns {Promise<boolean>} Whether the second has the triangles of the first; otherwise it is shown as it is.
   */
  async show(first, second, { apart = false } = {}) {
    this.files = [first, second];
    const [one, other] = this.views;
    // Each viewer has a copy: what it reads it may keep.
    const found = await Promise.all([one.load(first.slice(0), "glb"), other.load(first.slice(0), "glb")]);
    this.flat = found.includes(null);
    this.element.classList.toggle("flat", this.flat);
    this.comparable = found.every(Boolean) && (await other.deform(second.slice(0)));
    if (this.scope.over) return false;
    this.colours.hidden = !this.comparable;
    if (!this.comparable) return false;
    other.viewer?.setMorph(1);
    this.apart = apart;
    if (apart) await other.load(second.slice(0), "glb", true);
    await this.colour(this.kind);
    return true;
  }

  /** Show the picture that a job made, where nothing can be drawn. @param {Blob} picture */
  showPicture(picture) {
    this.element.querySelector(".stage")?.append(drawnPicture(this.scope, picture, "Before, above, and after, below, from four sides"));
  }

  /** @param {Colour} kind */
  colour(kind) {
    const before = this.kind;
    this.kind = kind;
    // One after the other, as they were chosen.
    this.work = this.work.then(() => this._colour(before, kind)).catch((error) => console.warn(error));
    return this.work;
  }

  /** @param {Colour} before @param {Colour} kind */
  async _colour(before, kind) {
    if (!this.comparable || this.scope.over) return;
    const [, other] = this.views;
    // Materials are those of the second file, colours those of the first one's way into it.
    if (this.apart && kind === "none" && before !== "none") await other.load(this.files[1].slice(0), "glb", true);
    if (this.apart && kind !== "none" && before === "none") {
      await other.load(this.files[0].slice(0), "glb", true);
      await other.deform(this.files[1].slice(0));
      other.viewer?.setMorph(1);
    }
    showLegend(this.legend, other.heatmap(kind));
  }
}
