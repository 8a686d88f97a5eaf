// @ts-check
/** Rows of what was said of an asset. */
import { button, h } from "../../dom.js";
import { regionWords } from "./model.js";

/** @param {string} words @param {() => void} remove @param {...(Node | null)} parts */
export function frame(words, remove, ...parts) {
  const title = h("strong", null, words);
  const element = h(
    "li",
    { class: "control-row", "aria-label": words },
    h("div", { class: "control-head" }, title, ...parts, button(`Remove ${words.toLowerCase()}`, remove, { icon: "trash", quiet: true, class: "button-quiet" })),
  );
  return { element, title };
}

/**
 * @param {import("./model.js").Region} region
 * @param {number} number
 * @param {[string, string][]} purposes What a region can be for: values of `action`, and words.
 * @param {(action: string) => void} onAction It is for something else.
 * @param {() => void} remove
 */
export function regionRow(region, number, purposes, onAction, remove) {
  const action = h("select", { class: "select-small", "aria-label": `Region ${number}: what happens to it`, on: { change: () => onAction(action.value) } }, purposes.map(([value, text]) => h("option", { value }, text)));
  action.value = region.action ?? "keep";
  const { element, title } = frame(`Region ${number}`, remove, action);
  const update = () => (title.textContent = regionWords(region));
  update();
  return { element, update };
}
