// @ts-check
/**
 * Rows of a form for the parameters that a server declares.
 *
 * @typedef {{input: HTMLInputElement, problem: HTMLElement, row: HTMLElement}} FieldRow
 */
import { client } from "../client.js";
import { h, invalid, labelled, say } from "../dom.js";
import { fieldProblem, numbersOf } from "../params.js";

/** @typedef {import("../params.js").Field} Field */

/**
 * @param {{name: string, label: string, help: string}} field
 * @param {string} empty What stands where nothing was typed.
 * @param {"decimal" | null} [mode] Of the keyboard.
 * @param {() => void} [onInput]
 * @returns {FieldRow}
 */
export function fieldRow({ name, label, help }, empty, mode = null, onInput = () => {}) {
  const id = `param-${name}`;
  const problem = h("p", { class: "field-problem", id: `${id}-problem`, hidden: true, "aria-live": "polite" });
  const input = h("input", { id, "aria-describedby": `${id}-help ${id}-problem`, type: "text", inputmode: mode, placeholder: empty, autocomplete: "off", on: { input: onInput } });
  return { input, problem, row: labelled(id, label, input, problem, h("p", { class: "small muted", id: `${id}-help` }, help)) };
}

/** Show what is wrong with a field; empty: nothing. @param {{input: HTMLElement, problem: HTMLElement}} field @param {string} text */
export function markField(field, text) {
  say(field.problem, text);
  invalid(field.input, text !== "");
}

/** The numbers of a kind of job as rows: the usual ones first, the others under Advanced. */
export class NumberRows {
  /** @param {string} kind @param {string[]} usual Their names. @param {() => void} onInput */
  constructor(kind, usual, onInput) {
    this.kind = kind;
    this.usual = usual;
    this.onInput = onInput;
    /** @type {Map<string, FieldRow & {field: Field}>} */
    this.rows = new Map();
    this.first = h("div", { class: "advanced-grid" });
    this.more = h("div", { class: "advanced-grid" });
    this.advanced = h("details", { class: "advanced" }, h("summary", null, "Advanced"), this.more);
  }

  /** Ask the server which there are. @param {AbortSignal} signal */
  async load(signal) {
    const { kinds } = await client.json("v1/limits", { signal });
    for (const field of numbersOf(kinds.find((/** @type {any} */ kind) => kind.name === this.kind)?.params)) {
      const row = fieldRow(field, String(field.standard), "decimal", () => (this._mark(field.name), this.onInput()));
      this.rows.set(field.name, { ...row, field });
      (this.usual.includes(field.name) ? this.first : this.more).append(row.row);
    }
  }

  /** Return whether all that was typed can be sent; what cannot is said beside it. */
  settle() {
    const good = [...this.rows.keys()].map((name) => this._mark(name)).every(Boolean);
    if (!good) this._unfold();
    return good;
  }

  /** Say what the server refused beside its rows. @param {any[]} errors @returns {boolean} whether there is a row for all of it */
  refuse(errors) {
    const found = errors.map(({ loc, msg }) => {
      const row = this.rows.get((loc ?? []).findLast((/** @type {any} */ name) => this.rows.has(name)));
      if (row) markField(row, String(msg ?? "Not allowed."));
      return row !== undefined;
    });
    this._unfold();
    return found.length > 0 && found.every(Boolean);
  }

  _unfold() {
    if (this.more.querySelector('[aria-invalid="true"]')) this.advanced.open = true;
  }

  /** @param {string} name @returns {boolean} whether what was typed can be sent */
  _mark(name) {
    const row = /** @type {FieldRow & {field: Field}} */ (this.rows.get(name));
    const text = fieldProblem(row.field, row.input.value);
    markField(row, text);
    return !text;
  }

  /** @param {string} name @returns {number | undefined} what a parameter is where nothing is typed */
  standard(name) {
    return this.rows.get(name)?.field.standard;
  }

  /** Show the parameters of another job. @param {Record<string, any>} params */
  fill(params) {
    for (const [name, value] of Object.entries(params)) {
      const row = this.rows.get(name);
      if (row && value !== this.standard(name)) row.input.value = String(value);
    }
  }

  /** @returns {Record<string, number>} what was typed */
  values() {
    const typed = [...this.rows].filter(([, { input }]) => input.value.trim());
    return Object.fromEntries(typed.map(([name, { input }]) => [name, Number(input.value)]));
  }
}
