// @ts-check
/** Rows of what was said of an asset. */
import { button, h, options } from "../../dom.js";
import { regionWords } from "./model.js";

/** @param {string} words @param {() => void} remove @param {...(Node | null)} tools */
export function frame(words, remove, ...tools) {
  const title = h("strong", null, words);
  const element = h(
    "li",
    { class: "control-row", "aria-label": words },
    h("div", { class: "control-head" }, title, ...tools, button(`Remove ${words.toLowerCase()}`, remove, { icon: "trash", quiet: true, class: "button-quiet" })),
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
  const action = h("select", { class: "select-small", "aria-label": `Region ${number}: what happens to it`, on: { change: () => onAction(action.value) } }, options(purposes));
  action.value = region.action ?? "keep";
  const { element, title } = frame(`Region ${number}`, remove, action);
  const update = () => (title.textContent = regionWords(region));
  update();
  return { element, update };
}
