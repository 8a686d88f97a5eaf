// @ts-check
/** A parameter that is a share of the whole, as a slider in percent. */
import { h } from "../dom.js";
import { slider } from "../job/stage-controls.js";

export class ShareSlider {
  /** @param {string} name Of the parameter. @param {() => void} onChange */
  constructor(name, onChange) {
    this.name = name;
    /** What it is where nobody moves it, in percent. */
    this.usual = 100;
    const help = h("p", { class: "small muted", id: `param-${name}-help` });
    const { input, value, row } = slider(`param-${name}`, "", 100, () => (this._draw(), onChange()));
    row.hidden = false;
    this.input = input;
    this.output = value;
    this.label = row.querySelector("label");
    this.help = help;
    input.setAttribute("aria-describedby", help.id);
    this.element = h("div", { class: "field", hidden: true }, row, help);
    this.set("");
  }

  /** @param {import("../params.js").Field[]} fields Of which one may be this parameter. */
  offer(fields) {
    const field = fields.find(({ name }) => name === this.name);
    if (!field || !this.label) return;
    this.label.textContent = field.label;
    this.help.textContent = field.help;
    this.usual = Math.round(100 * (field.standard ?? 1));
    this.set("");
  }

  /** As in a request; empty: as the server has it. */
  get value() {
    return Number(this.input.value) === this.usual ? "" : String(Number(this.input.value) / 100);
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
