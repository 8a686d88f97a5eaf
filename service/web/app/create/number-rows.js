// @ts-check
/** The numbers of a kind of job as rows of a form: the usual ones first, the others under Advanced. */
import { client } from "../client.js";
import { h } from "../dom.js";
import { fieldProblem, numbersOf } from "../params.js";
import { fieldRow, markField } from "./field-rows.js";

export class NumberRows {
  /** @param {string} kind @param {string[]} first Names of the usual ones. @param {() => void} onInput */
  constructor(kind, first, onInput) {
    this.kind = kind;
    this.names = first;
    this.onInput = onInput;
    /** @type {(import("../params.js").Field & {standard: number})[]} */
    this.fields = [];
    /** @type {Map<string, import("./field-rows.js").FieldRow>} */
    this.rows = new Map();
    this.first = h("div", { class: "advanced-grid" });
    this.more = h("div", { class: "advanced-grid" });
    this.advanced = h("details", { class: "advanced" }, h("summary", null, "Advanced"), this.more);
  }

  /** Ask the server which there are. @param {AbortSignal} signal */
  async load(signal) {
    const { kinds } = await client.json("v1/limits", { signal });
    this.fields = numbersOf(kinds.find((/** @type {any} */ kind) => kind.name === this.kind)?.params);
    for (const field of this.fields) {
      const row = fieldRow(field, ["", String(field.standard)], () => (this._mark(field), this.onInput()));
      this.rows.set(field.name, row);
      (this.names.includes(field.name) ? this.first : this.more).append(row.row);
    }
  }

  /** @param {string} name @returns {number | undefined} what a parameter is where nothing is typed */
  standard(name) {
    return this.fields.find((field) => field.name === name)?.standard;
  }

  /** Show the parameters of another job. @param {Record<string, any>} params */
  fill(params) {
    for (const [name, value] of Object.entries(params)) {
      const row = this.rows.get(name);
      if (row && value !== this.standard(name)) row.input.value = String(value);
    }
  }

  /** Return whether all that was typed can be sent; what cannot is said beside it. */
  settle() {
    const good = this.fields.map((field) => this._mark(field)).every(Boolean);
    if (this.more.querySelector('[aria-invalid="true"]')) this.advanced.open = true;
    return good;
  }

  /** @returns {Record<string, number>} what was typed */
  values() {
    const typed = [...this.rows].filter(([, { input }]) => input.value.trim());
    return Object.fromEntries(typed.map(([name, { input }]) => [name, Number(input.value)]));
  }

  /** Say what the server refused beside its rows. @param {any[]} errors @returns {boolean} whether there is a row for all of it */
  blame(errors) {
    const placed = errors.map(({ loc, msg }) => {
      const row = this.rows.get((loc ?? []).at(-1));
      if (row) markField(row, String(msg));
      return row !== undefined;
    });
    if (this.more.querySelector('[aria-invalid="true"]')) this.advanced.open = true;
    return placed.length > 0 && placed.every(Boolean);
  }

  /** @param {import("../params.js").Field} field @returns {boolean} whether what was typed can be sent */
  _mark(field) {
    const row = /** @type {import("./field-rows.js").FieldRow} */ (this.rows.get(field.name));
    const text = fieldProblem(field, row.input.value);
    markField(row, text);
    return !text;
  }
}
