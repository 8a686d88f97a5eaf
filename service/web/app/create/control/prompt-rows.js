// @ts-check
/** Further prompts below the first: their words, their weights, and where each pulls. */
import { announce } from "../../announce.js";
import { errorsOf } from "../../client.js";
import { button, fill, h, invalid, say } from "../../dom.js";
import { placeOf } from "../../groups.js";
import { showRefusal } from "../../refusal.js";
import { LONGEST } from "../prompt-field.js";
import { furtherProblem, MOST_PROMPTS, promptAction, promptName, regionsOf, written } from "./further.js";
import { numberField } from "./rows.js";

/** @typedef {import("./further.js").Further} Further */

const PLACES = /** @type {[Further["where"], string][]} */ ([["all", "Everywhere"], ["in", "In its regions"], ["out", "Outside of its regions"]]);

export class PromptRows {
  /** @param {import("./panel.js").ControlPanel} panel */
  constructor(panel) {
    this.panel = panel;
    /** What the model refuses, by the ids of prompts. @type {Map<number, unknown>} */
    this.refused = new Map();
    this.list = h("ul", { class: "control-rows", "aria-label": "Further prompts" });
    this.problem = h("p", { class: "field-problem", role: "status", hidden: true });
    this.add = button("Add a prompt", () => this._add(), { class: "chip", title: "Another prompt that pulls at the same time, everywhere or at a part" });
    this.element = h("div", { class: "field further" }, this.list, this.problem, h("div", { class: "chips" }, this.add));
    /** @type {Map<number, {input: HTMLTextAreaElement, place: HTMLElement}>} */
    this.fields = new Map();
    /** @type {{id: number, kind: string, element: HTMLElement}[]} */
    this.tools = [];
  }

  get prompts() {
    return this.panel.control.prompts;
  }

  /** What cannot be sent; empty where all is fine. */
  get fault() {
    return furtherProblem(this.prompts, this.panel.control.regions);
  }

  _add() {
    const { prompts } = this;
    const id = Math.max(0, ...prompts.map((each) => each.id)) + 1;
    prompts.push({ id, prompt: "", weight: 1, where: "all" });
    this.panel._structure();
    this.fields.get(id)?.input.focus();
  }

  /** @param {number} id */
  _remove(id) {
    const { panel } = this;
    announce(`${promptName(this.prompts, id)} removed`);
    panel.control.prompts = this.prompts.filter((each) => each.id !== id);
    panel.control.regions = panel.control.regions.filter(({ action }) => action !== promptAction(id));
    panel.boxed = -1;
    panel._aimElsewhere();
    panel._structure();
    this.add.focus();
  }

  /** A prompt that has a region pulls there. */
  settle() {
    for (const each of this.prompts) if (each.where === "all" && regionsOf(this.panel.control.regions, each.id).length) each.where = "in";
  }

  /** Take a tool in hand for the regions of a prompt. @param {Further} each @param {"paint" | "box" | "part"} tool */
  _pick(each, tool) {
    const { panel } = this;
    if (each.where === "all") each.where = "in";
    panel.aim(promptAction(each.id));
    if (tool === "box") return panel.addBox();
    panel.use(tool);
    panel.changed();
  }

  /** @param {(id: number) => HTMLElement[]} rowsOf The rows of a prompt's regions. */
  show(rowsOf) {
    // The rows are made anew: the focus stays where it was, at an element of the same name.
    const focused = this.list.contains(document.activeElement) ? /** @type {HTMLElement} */ (document.activeElement) : null;
    const typing = focused instanceof HTMLTextAreaElement ? focused.selectionEnd : null;
    this.fields.clear();
    this.tools = [];
    fill(this.list, this.prompts.map((each) => this._row(each, rowsOf(each.id))));
    this.list.hidden = !this.prompts.length;
    this.add.hidden = this.prompts.length >= MOST_PROMPTS;
    this.press();
    const again = focused && [...this.list.querySelectorAll(focused.tagName)].find((each) => nameOf(each) === nameOf(focused));
    if (!(again instanceof HTMLElement)) return;
    again.focus();
    if (again instanceof HTMLTextAreaElement && typing !== null) again.setSelectionRange(typing, typing);
  }

  /** Show which tool is in hand. */
  press() {
    const { tool, action } = this.panel;
    for (const { id, kind, element } of this.tools) element.setAttribute("aria-pressed", String(tool === kind && action === promptAction(id)));
  }

  /** @param {Further} each @param {HTMLElement[]} regions */
  _row(each, regions) {
    const { panel } = this;
    const name = promptName(this.prompts, each.id);
    const id = `further-${each.id}`;
    const input = h("textarea", { id, rows: 1, maxlength: LONGEST, spellcheck: "true", autocapitalize: "none", placeholder: "a rabbit", "aria-describedby": `${id}-problem`, ".value": each.prompt });
    input.addEventListener("input", () => {
      each.prompt = input.value;
      panel.reworded();
    });
    input.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" || event.shiftKey || event.isComposing) return;
      event.preventDefault();
      input.form?.requestSubmit();
    });
    const place = h("div", { class: "field-problem", id: `${id}-problem`, "aria-live": "polite", hidden: true });
    this.fields.set(each.id, { input, place });
    const weight = numberField(`Weight of ${name.toLowerCase()}`, () => each.weight, (value) => {
      each.weight = value;
      panel.reworded();
    });
    const where = h("select", { class: "select-small", "aria-label": `Where ${name.toLowerCase()} pulls` }, PLACES.map(([value, text]) => h("option", { value }, text)));
    where.value = each.where;
    where.addEventListener("change", () => {
      each.where = /** @type {Further["where"]} */ (where.value);
      if (each.where === "all") panel.control.regions = panel.control.regions.filter(({ action }) => action !== promptAction(each.id));
      panel.boxed = -1;
      panel._structure();
    });
    const tool = (/** @type {"paint" | "box" | "part"} */ kind, /** @type {string} */ text) => {
      const element = h("button", { type: "button", class: "chip chip-small", "aria-pressed": "false", on: { click: () => this._pick(each, kind) } }, text);
      this.tools.push({ id: each.id, kind, element });
      return element;
    };
    const tools = h("div", { class: "chips", role: "group", "aria-label": `Regions of ${name.toLowerCase()}` }, panel.view.possible ? tool("paint", "Paint a region") : null, tool("box", "Add a box"), panel.view.possible ? tool("part", "Pick a part") : null);
    const row = h(
      "li",
      { class: "control-row further-row", "aria-label": name },
      h("div", { class: "control-head" }, h("label", { class: "field-label", for: id }, name), button(`Remove ${name.toLowerCase()}`, () => this._remove(each.id), { icon: "trash", quiet: true, class: "button-quiet" })),
      input,
      place,
      h("div", { class: "row further-how" }, h("label", null, h("span", { class: "small muted" }, "Weight"), weight.input), h("label", null, h("span", { class: "small muted" }, "Where"), where)),
      tools,
      regions.length ? h("ul", { class: "control-rows", "aria-label": `Regions of ${name.toLowerCase()}, listed` }, regions) : null,
    );
    this._refusal(each.id);
    return row;
  }

  /** @param {string} text What cannot be sent; empty: all is well. */
  say(text) {
    say(this.problem, text);
  }

  /** Return whether the prompts can be sent; what cannot is said. */
  check() {
    this.say(this.fault);
    return !this.fault && !this.element.querySelector('[aria-invalid="true"]:not(textarea)');
  }

  /** Whether there is a prompt to send. */
  get any() {
    return written(this.prompts).length > 0;
  }

  /** Take away what was said about all of them. */
  accept() {
    const ids = [...this.refused.keys()];
    this.refused.clear();
    for (const id of ids) this._refusal(id);
  }

  /**
   * Say which of the prompts the model does not understand, with what it would.
   * @param {import("../../client.js").MeshdeformError} error
   * @param {boolean} alone Whether the request has no prompt of its own.
   * @returns {boolean} Whether it is one of these.
   */
  refuse(error, alone) {
    const [first] = errorsOf(error);
    const sent = written(this.prompts);
    const [name, number] = placeOf(first ?? {});
    const at = name === "prompts" ? Number(number) : !first && alone && sent.length === 1 ? 0 : -1;
    const found = sent[at];
    if (!found) return false;
    this.accept();
    this.refused.set(found.id, error);
    this._refusal(found.id);
    return true;
  }

  /** @param {number} id */
  _refusal(id) {
    const field = this.fields.get(id);
    const found = this.refused.get(id);
    if (!field) return;
    field.place.hidden = !found;
    invalid(field.input, found !== undefined);
    if (!found) return void fill(field.place);
    showRefusal(field.place, found, (text) => {
      field.input.value = text;
      field.input.dispatchEvent(new Event("input"));
      field.input.focus();
    });
  }

  focusProblem() {
    /** @type {HTMLElement | null} */ (this.element.querySelector('[aria-invalid="true"]') ?? this.list.querySelector("textarea"))?.focus();
  }
}

/** What tells an element of the rows from the others. @param {Element} element */
function nameOf(element) {
  return `${element.id} ${element.getAttribute("aria-label")} ${element.closest("li")?.getAttribute("aria-label")} ${element instanceof HTMLButtonElement ? element.textContent : ""}`;
}
