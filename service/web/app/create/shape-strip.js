// @ts-check
/** The shapes that an asset has had, oldest first: a click goes back to one. They stay while the page is open, for whichever job shows the asset. */
import { h, refill } from "../dom.js";
import { PICTURE } from "./live.js";

/** @typedef {import("./live.js").Shape} Shape */

const MOST = 12;
/** Made here without a job, by the asset that they are of. @type {Map<string, Shape[]>} */
const MADE = new Map();

export class ShapeStrip {
  /** @param {import("../scope.js").Scope} scope @param {(shape: Shape) => void} onTake @param {() => void} onChange There are others. */
  constructor(scope, onTake, onChange) {
    this.scope = scope;
    this.onTake = onTake;
    this.onChange = onChange;
    /** The asset that the shapes are of. */
    this.of = "";
    /** Those of jobs. @type {Shape[]} */
    this.stored = [];
    /** That in the view. @type {Shape | null} */
    this.shown = null;
    /** @type {Map<Blob, string>} */
    this.addresses = new Map();
    this.list = h("div", { class: "shape-strip", role: "group", "aria-label": "Shapes so far" });
    this.element = h("div", { class: "shapes", hidden: true }, h("p", { class: "field-label" }, "Shapes so far"), this.list);
  }

  /** @param {string} asset */
  begin(asset) {
    if (asset === this.of) return;
    this.of = asset;
    this._draw();
  }

  /** Those that there are, oldest first. @returns {Shape[]} */
  get shapes() {
    const keys = new Set(this.stored.map(({ key }) => key));
    return [...this.stored, ...(MADE.get(this.of) ?? []).filter(({ key }) => !keys.has(key))];
  }

  /** Take up those that jobs have. @param {Shape[]} stored */
  offer(stored) {
    this.stored = stored;
    this._draw();
  }

  /** Take up a shape, and mark it as the one in the view. @param {Shape | null} shape */
  show(shape) {
    this.shown = shape;
    if (shape && !shape.stored && !shape.href) {
      const made = MADE.get(this.of) ?? [];
      const at = made.findIndex(({ key }) => key === shape.key); // one gone back to stays in its place
      MADE.set(this.of, at < 0 ? [...made, shape].slice(-MOST) : made.with(at, shape));
    }
    this._draw();
  }

  _draw() {
    const { shapes } = this;
    refill(this.list, shapes.map((shape, i) => this._button(shape, i + 1)));
    this.element.hidden = !shapes.length;
    this.onChange();
  }

  /** @param {Shape} shape @param {number} number */
  _button(shape, number) {
    const here = shape.key === this.shown?.key;
    const image = shape.picture ? h("img", { alt: "", width: PICTURE / 2, height: PICTURE / 2, src: this._address(shape.picture) }) : null;
    return h("button", { type: "button", class: "shape", "aria-pressed": String(here), title: shape.label, on: { click: () => this.onTake(shape) } }, image, h("span", { class: "shape-name" }, `${number} · ${shape.label}`));
  }

  /** @param {Blob} picture */
  _address(picture) {
    const known = this.addresses.get(picture) ?? this.scope.url(picture);
    this.addresses.set(picture, known);
    return known;
  }
}
