// @ts-check
/** The controls below the 3D views of a job. */
import { fill, h } from "../dom.js";
import { figure } from "../format.js";

/** @param {string} label @param {[string, string][]} options @param {string} chosen @param {(value: string) => void} onChange */
export function segmented(label, options, chosen, onChange) {
  const name = `segment-${label.toLowerCase()}`;
  return h(
    "fieldset",
    { class: "segmented" },
    h("legend", { class: "visually-hidden" }, label),
    options.map(([value, text]) =>
      h("label", null, h("input", { type: "radio", name, ".checked": value === chosen, on: { change: () => onChange(value) } }), h("span", null, text)),
    ),
  );
}

/** @param {string} label @param {(on: boolean) => void} onChange */
export function toggle(label, onChange) {
  const element = h("button", { type: "button", class: "button button-toggle", "aria-pressed": "false" }, label);
  element.addEventListener("click", () => {
    const on = element.getAttribute("aria-pressed") !== "true";
    element.setAttribute("aria-pressed", String(on));
    onChange(on);
  });
  return element;
}

/** A slider with its label and its value. @param {string} id @param {string} label @param {number} max @param {() => void} onInput */
export function slider(id, label, max, onInput) {
  const input = h("input", { type: "range", min: 0, max, step: 1, id, on: { input: onInput } });
  const value = h("output", { for: id, class: "range-value" });
  const row = h("div", { class: "range-row", hidden: true }, h("label", { for: id }, label), input, value);
  return { input, value, row };
}

/** A list with its label, of which one thing is chosen. @param {string} id @param {string} label @param {() => void} onChange */
export function chooser(id, label, onChange) {
  const input = h("select", { id, on: { change: onChange } });
  const row = h("div", { class: "range-row", hidden: true }, h("label", { for: id }, label), input);
  return { input, row };
}

/** The picture that a job made, over the place of its views. @param {import("../scope.js").Scope} scope @param {Blob} picture @param {string} alt */
export function drawnPicture(scope, picture, alt) {
  return h("div", { class: "stage-picture" }, h("img", { src: scope.url(picture), alt }));
}

/** Explain the colours of a heat map. @param {HTMLElement} legend @param {import("../viewer-box.js").Scale | null} scale */
export function showLegend(legend, scale) {
  legend.hidden = !scale;
  if (!scale) return;
  if (scale.problem) {
    fill(legend, h("span", null, scale.problem));
    return;
  }
  const ramp = h("div", { class: "ramp", "aria-hidden": "true" });
  ramp.style.backgroundImage = scale.gradient;
  const ticks = h("div", { class: "ramp-ticks", "aria-hidden": "true" }, scale.ticks.map(({ text, at }) => {
    const tick = h("span", null, text);
    tick.style.insetInlineStart = `${100 * at}%`;
    tick.style.translate = `${-100 * at}%`; // the first and the last end with the ramp
    return tick;
  }));
  const unit = scale.unit === "×" ? "times" : scale.unit;
  const words = `from ${figure(scale.min)} to ${figure(scale.max)} ${unit}, 99 percent at most ${figure(scale.p99)}`;
  fill(
    legend,
    h("span", null, h("strong", null, scale.label), scale.unit ? `, ${scale.unit}` : ""),
    ramp,
    ticks,
    h("span", { class: "visually-hidden" }, words),
  );
}
