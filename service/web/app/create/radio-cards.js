// @ts-check
/** A choice of which each option says what it means. */
import { h, uniqueId } from "../dom.js";

/** @typedef {[string, string, string]} Option Value, label, what it means. */

/** @param {string} name @param {Option[]} options @param {string} chosen @param {() => void} onChange */
export function radioCards(name, options, chosen, onChange) {
  const inputs = options.map(([value]) => h("input", { type: "radio", name, value, id: uniqueId(name), ".checked": value === chosen, on: { change: onChange } }));
  const texts = options.map(([, , text]) => h("span", { class: "small muted" }, text));
  const element = h(
    "div",
    { class: "cards" },
    options.map(([, label], index) => h("label", { class: "card-choice", for: inputs[index].id }, inputs[index], h("span", { class: "card-title" }, label), texts[index])),
  );
  return {
    element,
    inputs,
    texts,
    value: () => inputs.find((input) => input.checked)?.value ?? chosen,
    set: (/** @type {string} */ value) => inputs.forEach((input) => (input.checked = input.value === value)),
  };
}
