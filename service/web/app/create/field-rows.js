// @ts-check
/**
 * Rows of a form for the parameters that a server declares.
 *
 * @typedef {{input: HTMLInputElement | HTMLSelectElement, problem: HTMLElement, row: HTMLElement}} FieldRow
 */
import { fill, h } from "../dom.js";

/**
 * @param {import("../params.js").Field} field
 * @param {[string, string]} empty What stands where nothing was chosen, and where nothing was typed.
 * @param {() => void} onInput
 * @returns {FieldRow}
 */
export function fieldRow(field, [unchosen, untyped], onInput) {
  const id = `param-${field.name}`;
  const problem = h("p", { class: "field-problem", id: `${id}-problem`, hidden: true, "aria-live": "polite" });
  const common = { id, "aria-describedby": `${id}-help ${id}-problem` };
  const input =
    field.type === "choice"
      ? h("select", common, h("option", { value: "" }, unchosen), (field.choices ?? []).map(([value, label]) => h("option", { value }, label)))
      : h("input", { ...common, type: "text", inputmode: field.type === "text" ? null : "decimal", placeholder: untyped, autocomplete: "off" });
  input.addEventListener("input", onInput);
  const row = h(
    "div",
    { class: "field" },
    h("label", { class: "field-label", for: id }, field.label),
    input,
    problem,
    h("p", { class: "small muted", id: `${id}-help` }, field.help),
  );
  return { input, problem, row };
}

/**
 * Show what is wrong with a field; empty: nothing.
 * @param {{input: HTMLElement, problem: HTMLElement}} field
 * @param {string} text
 */
export function markField(field, text) {
  field.problem.hidden = !text;
  fill(field.problem, text);
  if (text) field.input.setAttribute("aria-invalid", "true");
  else field.input.removeAttribute("aria-invalid");
}
