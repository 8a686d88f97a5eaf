// @ts-check
/** A page to draw on with a mouse, a pen or a finger: strokes over a picture, if one was dropped, and a way back. */
import { h } from "../../dom.js";

const SIDE = 512;
const WIDTH = 4;

export class SketchPad {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {[number, number][][]} */
    this.strokes = [];
    /** @type {ImageBitmap | null} */
    this.picture = null;
    /** Whether the picture is a sample, which gives way to the first stroke. */
    this.sample = false;
    /** The pointer that draws; -1: none. */
    this.pointer = -1;
    this.element = h("canvas", { class: "sketch-pad", width: SIDE, height: SIDE, role: "img", "aria-label": "Drawing" });
    this.element.addEventListener("pointerdown", (event) => this._begin(event));
    this.element.addEventListener("pointermove", (event) => this._go(event));
    for (const type of ["pointerup", "pointercancel"]) this.element.addEventListener(type, (event) => this._end(/** @type {PointerEvent} */ (event)));
    this._draw();
  }

  /** Whether there is nothing on the page. */
  get isEmpty() {
    return !this.strokes.length && !this.picture;
  }

  /** Take the last stroke back, or the picture if there is none. */
  undo() {
    if (!this.strokes.pop()) this.picture = null;
    this._changed();
  }

  clear() {
    this.strokes = [];
    this.picture = null;
    this._changed();
  }

  /** Draw on a picture from now on. @param {Blob} file @param {boolean} [sample] It gives way to the first stroke. @returns {Promise<boolean>} whether the browser can read it */
  async take(file, sample = false) {
    const picture = await createImageBitmap(file).catch(() => null);
    if (!picture || (sample && !this.isEmpty)) return false;
    this.sample = sample;
    this.strokes = [];
    this.picture = picture;
    this._changed();
    return true;
  }

  /** @returns {Promise<Blob>} a PNG */
  png() {
    return new Promise((resolve, reject) => this.element.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The drawing could not be written."))), "image/png"));
  }

  /** @param {PointerEvent} event @returns {[number, number]} */
  _at(event) {
    const { left, top, width, height } = this.element.getBoundingClientRect();
    return [((event.clientX - left) / width) * SIDE, ((event.clientY - top) / height) * SIDE];
  }

  /** @param {PointerEvent} event */
  _begin(event) {
    if (this.pointer >= 0 || event.button !== 0) return;
    event.preventDefault();
    if (this.sample) this.picture = null;
    this.sample = false;
    this.pointer = event.pointerId;
    this.element.setPointerCapture(event.pointerId);
    this.strokes.push([this._at(event)]);
    this._draw();
  }

  /** @param {PointerEvent} event */
  _go(event) {
    if (event.pointerId !== this.pointer) return;
    this.strokes[this.strokes.length - 1].push(this._at(event));
    this._draw();
  }

  /** @param {PointerEvent} event */
  _end(event) {
    if (event.pointerId !== this.pointer) return;
    this.pointer = -1;
    this._changed();
  }

  _changed() {
    this._draw();
    this.onChange();
  }

  _draw() {
    const pen = /** @type {CanvasRenderingContext2D} */ (this.element.getContext("2d"));
    pen.fillStyle = "white";
    pen.fillRect(0, 0, SIDE, SIDE);
    if (this.picture) {
      const { width, height } = this.picture;
      const scale = SIDE / Math.max(width, height);
      pen.drawImage(this.picture, (SIDE - width * scale) / 2, (SIDE - height * scale) / 2, width * scale, height * scale);
    }
    pen.strokeStyle = "black";
    pen.lineWidth = WIDTH;
    pen.lineCap = pen.lineJoin = "round";
    for (const stroke of this.strokes) {
      pen.beginPath();
      pen.moveTo(...stroke[0]);
      for (const point of stroke.length > 1 ? stroke.slice(1) : stroke) pen.lineTo(...point);
      pen.stroke();
    }
  }
}
