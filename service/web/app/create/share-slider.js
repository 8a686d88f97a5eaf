// @ts-check
/** How far a shape goes, as a slider in percent: the parameter `strength` of a fit, and the share of any result. */
import { h } from "../dom.js";
import { slider } from "../widgets.js";

export class ShareSlider {
  /** @param {string} name Of the parameter. @param {() => void} onChange */
  constructor(name, onChange) {
    /** What it is where nobody moves it, in percent. */
    this.usual = 100;
    const { input, value, row } = slider(`param-${name}`, "Strength", 100, () => (this._draw(), onChange()));
    this.input = input;
    this.output = value;
    this.element = h("div", { class: "field", hidden: true }, row);
    this.set("");
  }

  /** @param {number} [usual] What it is where nobody moves it. */
  offer(usual = 1) {
    this.usual = Math.round(100 * usual);
    this.set("");
  }

  /** From 0; beyond 1 where more can be seen of a result than can be asked for. */
  get share() {
    return Number(this.input.value) / 100;
  }

  /** @param {boolean} on Whether it goes beyond the whole way. */
  exaggerate(on) {
    this.input.max = on ? "150" : "100";
    this._draw();
  }

  /** As in a request; empty: as the server has it. */
  get value() {
    const share = Math.min(1, this.share);
    return Math.round(100 * share) === this.usual ? "" : String(share);
  }

  /** @param {string} text As `value` gave it. */
  set(text) {
    this.input.value = String(text === "" ? this.usual : Math.round(100 * Number(text)));
    this._draw();
  }

  _draw() {
    this.output.textContent = `${this.input.value}%`;
    this.input.setAttribute("aria-valuetext", `${this.input.value} percent`);
  }
}
