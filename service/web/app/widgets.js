// @ts-check
/** What is chosen, switched and moved by hand, and the picture where nothing can be. */
import { h } from "./dom.js";

/** @param {string} label @param {[string, string][]} options @param {string} chosen @param {(value: string) => void} onChange */
export function segmented(label, options, chosen, onChange) {
  const name = `segment-${label.toLowerCase()}`;
  return h(
    "fieldset",
    { class: "segmented" },
    h("legend", { class: "visually-hidden" }, label),
    options.map(([value, text]) =>
      h("label", null, h("input", { type: "radio", name, value, ".checked": value === chosen, on: { change: () => onChange(value) } }), h("span", null, text)),
    ),
  );
}

/** Choose another option of what `segmented` made. @param {HTMLElement} group @param {string} value */
export function choose(group, value) {
  for (const input of group.querySelectorAll("input")) input.checked = input.value === value;
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
  const row = h("div", { class: "range-row" }, h("label", { for: id }, label), input, value);
  return { input, value, row };
}

/** The picture that a job made, over its views. @param {import("./scope.js").Scope} scope @param {Blob} picture @param {string} alt */
export function drawnPicture(scope, picture, alt) {
  return h("div", { class: "stage-picture" }, h("img", { src: scope.url(picture), alt }));
}
