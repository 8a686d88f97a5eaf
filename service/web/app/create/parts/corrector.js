// @ts-check
/** What is wrong with a part: its name, its faces, or that it is two; and all that was said so far, to take it back. */
import { announce } from "../../announce.js";
import { ask } from "../../dialogs.js";
import { chip, fill, h, labelled } from "../../dom.js";
import { controlParams, readingOf, regionWords } from "../control/model.js";
import { frame } from "../control/rows.js";
import { joined, moved, NAME, namingWords, partAction, partOf } from "./naming.js";

/** @typedef {import("./sentence.js").Part} Part */

export class Corrector {
  /**
   * @param {import("../control/panel.js").ControlPanel} panel
   * @param {import("../../scope.js").Scope} scope
   * @param {(part: Part) => string} origin How a part was found, in words.
   * @param {(parts: string[], name: string) => void} renamed Told of parts that have a name from now on.
   */
  constructor(panel, scope, origin, renamed) {
    this.originOf = origin;
    this.panel = panel;
    this.scope = scope;
    this.renamed = renamed;
    /** @type {Part | null} */
    this.part = null;
    /** @type {Part[]} */
    this.parts = [];
    /** Names to choose from. @type {string[]} */
    this.known = [];
    this.origin = h("span", { class: "small muted" });
    this.rename = chip("Rename…", () => this._rename());
    this.paint = chip("Paint", () => this._paint());
    this.back = chip("As it was found", () => this._forget(this.part?.name ?? ""));
    this.add = chip("Another part…", () => this._add());
    this.tools = h("div", { class: "row" }, this.origin, this.rename, this.paint, this.back);
    this.tools.setAttribute("role", "group");
    this.list = h("ul", { class: "control-rows", "aria-label": "Corrections" });
    this.element = h("div", { class: "corrector" }, this.tools, this.list, h("div", { class: "chips" }, this.add));
  }

  /** What is painted now; null: nothing. @returns {string | null} */
  get painting() {
    return this.panel.tool === "turn" ? null : partOf(this.panel.action);
  }

  /** Whether anything was said of the asset. */
  get any() {
    return Object.keys(controlParams(readingOf(this.panel.control))).length > 0;
  }

  /** Whether anything was said of a part. @param {Part} part */
  corrects({ name }) {
    const { names, regions } = this.panel.control;
    return names.some((each) => each.name === name) || regions.some(({ action }) => action === partAction(name));
  }

  /** @param {Part[]} parts @param {Part | null} part That is chosen. */
  show(parts, part) {
    this.parts = parts;
    this.part = part;
    this.tools.hidden = !part;
    this.tools.setAttribute("aria-label", `Correct ${part?.name}`);
    this.origin.textContent = part ? this.originOf(part) : "";
    this.press();
  }

  /** Show what was said, and whether a part is painted. */
  press() {
    const { names, regions } = this.panel.control;
    const { possible } = this.panel.view;
    this.add.hidden = this.paint.hidden = !possible;
    this.paint.setAttribute("aria-pressed", String(this.painting !== null && this.painting === this.part?.name));
    const painted = regions.filter(({ action }) => partOf(action) !== null);
    this.back.hidden = !this.part || !this.corrects(this.part);
    const rows = [
      ...names.map((each) => ({ words: namingWords(each), remove: () => this.panel.correct({ names: names.filter((other) => other !== each) }) })),
      ...painted.map((each) => ({ words: `“${partOf(each.action)}”: ${regionWords(each).toLowerCase()}`, remove: () => this.panel.correct({ regions: regions.filter((other) => other !== each) }) })),
    ];
    fill(this.list, rows.map(({ words, remove }) => frame(words, () => this._remove(remove)).element));
    this.list.hidden = !rows.length;
  }

  /** @param {() => void} remove */
  _remove(remove) {
    remove();
    announce("Correction removed");
    (this.add.hidden ? this.rename : this.add).focus();
  }

  /** @param {string[]} parts @param {string} name Theirs from now on. */
  _call(parts, name) {
    const { names, regions } = this.panel.control;
    const all = this.parts.some((each) => each.name === name) ? [name, ...parts] : parts;
    this.renamed(parts, name);
    this.panel.correct({ names: joined(names, all, name), regions: moved(regions, parts, name) });
  }

  _rename() {
    const part = /** @type {Part} */ (this.part);
    this._name(`What is “${part.name}”?`, "Rename", (name) => this._call([part.name], name));
  }

  _add() {
    this._name("What part is it?", "Paint it", (name) => this._begin(name));
  }

  /** Ask for the name of a part. @param {string} title @param {string} action @param {(name: string) => void} act */
  _name(title, action, act) {
    const words = [...new Set([...this.known, ...this.parts.map(({ name }) => name)])];
    const input = h("input", { type: "text", id: "part-name", list: "part-names", required: true, maxlength: 40, pattern: NAME, autocomplete: "off", autocapitalize: "none", title: "Letters, digits, spaces, - and _" });
    const list = h("datalist", { id: "part-names" }, words.map((value) => h("option", { value })));
    ask({ title, body: [labelled("part-name", "Name", input), list, h("p", { class: "small muted" }, "With the name of another part it is one with that.")], action, act: async () => act(input.value.trim().toLowerCase()) }, this.scope);
  }

  _paint() {
    const { name } = /** @type {Part} */ (this.part);
    if (this.painting === name) this.rest();
    else this._begin(name);
  }

  /** Take the brush for what belongs to a part besides what was found. @param {string} name */
  _begin(name) {
    const { panel } = this;
    const action = partAction(name);
    if (!panel.control.regions.some((each) => each.action === action)) panel.addRegion({ faces: [], action });
    panel.aim(action);
    panel.use("paint");
    panel.view.box.element.scrollIntoView({ block: "nearest" });
  }

  /** Lay the brush down. */
  rest() {
    if (this.painting === null) return;
    this.panel.aim("keep");
    this.panel.use("turn");
  }

  /** @param {string} name Of a part about which nothing is said any more. */
  _forget(name) {
    const { names, regions } = this.panel.control;
    this.panel.correct({ names: names.filter((each) => each.name !== name), regions: regions.filter(({ action }) => action !== partAction(name)) });
    this.rename.focus();
  }
}
