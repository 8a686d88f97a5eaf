// @ts-check
/** Which side of the asset is its front: an arrow in the view, a slider, and a way back to "automatic". */
import { button, h } from "../dom.js";
import { slider } from "../job/stage-controls.js";
import { isFrontSure } from "./parts/reading.js";

const STEP = 5;

/**
 * The angle that a value of the parameter `orientation` means.
 * @param {string} value "auto", "keep", an angle in degrees, or empty
 * @returns {number | null} 0 to 359; null where it is as the asset is read
 */
export function angleOf(value) {
  if (value === "keep") return 0;
  const angle = Number(value);
  return value === "" || value === "auto" || !Number.isFinite(angle) ? null : ((angle % 360) + 360) % 360;
}

export class FrontControl {
  /**
   * @param {import("../viewer-box.js").ViewerBox} box
   * @param {(value: string) => void} onChange With a value for `orientation`; empty: as the quality says.
   */
  constructor(box, onChange) {
    this.box = box;
    this.onChange = onChange;
    /** As the asset is read. @type {import("./parts/reading.js").Reading | null} */
    this.reading = null;
    this.value = "";
    this.resolved = "auto";
    const { input, value, row } = slider("front-slider", "Front", 360 - STEP, () => this.choose(input.value));
    this.input = input;
    this.output = value;
    input.step = String(STEP);
    this.reset = button("Automatic", () => this.choose(""), { class: "chip chip-small" });
    this.element = h("div", { class: "row front-control", hidden: true }, row, this.reset);
    row.hidden = false;
    box.ready.then(() => {
      box.viewer?.addEventListener("frontchange", (/** @type {CustomEvent<{degrees: number}>} */ event) => this.choose(String(event.detail.degrees)));
      this._draw();
    });
  }

  /** Offer the choice, or no more: a target mesh leaves no front to find. @param {boolean} on */
  offer(on) {
    this.element.hidden = !on;
    this._draw();
  }

  /** @param {string} value Of `orientation`, as it is in the form. */
  show(value) {
    this.value = value;
    this._draw();
  }

  /** @param {unknown} value Of `orientation`, as the server would take it where the form leaves it open. */
  resolve(value) {
    this.resolved = String(value ?? "keep");
    this._draw();
  }

  /** Show the front that the asset is read with, where nobody chose another. @param {import("./parts/reading.js").Reading | null} reading */
  read(reading) {
    this.reading = reading;
    this._draw();
  }

  /** @param {string} value */
  choose(value) {
    this.show(value);
    this.onChange(value);
  }

  _draw() {
    const angle = angleOf(this.value || this.resolved);
    const words = angle === null ? "Automatic" : `${angle}°`;
    this.input.value = String(angle ?? 0);
    this.output.textContent = words;
    this.input.setAttribute("aria-valuetext", angle === null ? "Automatic: found by what the asset is" : `${angle} degrees from +Z towards +X`);
    this.reset.hidden = this.value === "";
    const read = angleOf(this.value) === null ? (this.reading?.front_azimuth_deg ?? null) : null;
    this.box.viewer?.setFront(this.element.hidden ? null : (read ?? angle ?? 0), read === null ? angle === null : !(this.reading && isFrontSure(this.reading)));
  }
}
