// @ts-check
/** What stays: parts of the asset, or what is painted; and what a person said of what it is. */
import { announce, toast } from "../../announce.js";
import { chip, fill, h, labelled, options, say } from "../../dom.js";
import { fieldOf } from "../../groups.js";
import { CONTROL_PARAMS, controlProblem, History, isEmpty, isPart, noControl, READING_PARAMS, readingOf, SYMMETRIES, unaimed } from "./model.js";
import { partAction, partOf } from "../parts/naming.js";
import { regionRow } from "./rows.js";
import { Toolbar } from "./toolbar.js";
import { ControlView } from "./view.js";

/** @typedef {import("./model.js").Control} Control */
/** @typedef {import("../parts/sentence.js").Part} Part */
/** @typedef {import("../../../viewer/control/tools.js").Tool} Tool */

const MOST_REGIONS = 64;

export class ControlPanel {
  /** @param {import("../../viewer-box.js").ViewerBox} box @param {() => void} onChange */
  constructor(box, onChange) {
    this.onChange = onChange;
    this.control = noControl();
    this.history = new History(this.control);
    this.back = this.history.mark();
    /** Name and size of the file that the regions are for. */
    this.of = "";
    /** That which is shown. */
    this.asset = "";
    /** @type {Tool} */
    this.tool = "turn";
    this.action = "keep";
    this.erasing = false;
    this.subdivided = false;
    /** @type {ReturnType<typeof regionRow>[]} */
    this.rows = [];
    /** What shows how the asset is read. @type {{press: () => void, refuse: (text: string) => void} | null} */
    this.reader = null;
    this.view = new ControlView(box, this);
    this.lists = h("div", { class: "control-lists" });
    this.problem = h("p", { class: "field-problem", role: "status", hidden: true });
    this.undoButton = chip("Undo", () => this.undo());
    this.clearButton = chip("Clear all", () => this._clear());
    this.count = h("span", { class: "small muted" });
    this.symmetry = h("select", { id: "control-symmetry" }, options(SYMMETRIES));
    this.symmetry.addEventListener("change", () => {
      this.control.symmetry = this.symmetry.value;
      this.changed();
    });
    this.bar = new Toolbar(this);
    this.toolbar = this.bar.element;
    /** @type {HTMLDetailsElement} */
    this.element = this._fold();
    this._show();
  }

  _fold() {
    const fold = h(
      "details",
      { class: "advanced control-panel" },
      h("summary", null, "Control ", this.count),
      h("p", { class: "small muted" }, "Choose a part above to keep it as it is, or paint below the view what stays."),
      this.lists,
      this.problem,
      h("div", { class: "row" }, this.undoButton, this.clearButton),
      labelled("control-symmetry", "Symmetry", this.symmetry),
    );
    fold.addEventListener("toggle", () => this.showBrush());
    return fold;
  }

  /** Return what the form holds, for a draft or a request. */
  value() {
    return { ...structuredClone(this.control), of: this.of };
  }

  /** @param {(Control & {of?: string}) | null | undefined} control As `value` gave it. */
  restore(control) {
    const { of = "", ...found } = /** @type {Control & {of?: string}} */ (control ?? noControl());
    this.control = { ...noControl(), ...structuredClone(found) };
    this.of = of || this.asset;
    this._aimElsewhere();
    this._belong();
    this.history.reset(this.control);
    if (!isEmpty(this.control)) this.element.open = true;
    this._show();
  }

  /** Say which file is shown. @param {string} key */
  assetIs(key) {
    this.asset = key;
    if (!this.of) this.of = key;
    this._belong();
  }

  /** Nothing that was said about another file holds for the one that is shown. */
  _belong() {
    if (!this.asset || this.of === this.asset) return;
    this.of = this.asset;
    const { regions, noun, front, names } = this.control;
    if (!regions.length && !noun && !front && !names.length) return;
    this.control = { ...noControl(), symmetry: this.control.symmetry };
    this.history.reset(this.control);
    this._show();
    toast(`${regions.length ? "Regions" : "Corrections"} belonged to the other file, and are removed`);
  }

  /** @param {Tool} tool */
  use(tool) {
    this.tool = tool;
    this._show();
    this.view.use(tool);
  }

  /** What a region can be for: values of its `action`, and words. @returns {[string, string][]} */
  get purposes() {
    const { regions } = this.control;
    const parts = [...new Set(regions.map(({ action }) => partOf(action)))].filter((name) => name !== null);
    const pairs = /** @type {[string, string][]} */ (parts.map((name) => [partAction(name), `Part “${name}”`]));
    return [["keep", "Keep"], ["only", "Only this moves"], ...pairs];
  }

  /** Take what was said of what the asset is. @param {Partial<Control>} said */
  correct(said) {
    Object.assign(this.control, said);
    this._aimElsewhere();
    this._structure();
  }

  /** Let new regions be for something. @param {string} action */
  aim(action) {
    this.action = action;
    this._show();
  }

  /** What new regions are for must be there. */
  _aimElsewhere() {
    if (this.purposes.some(([action]) => action === this.action)) return;
    this.action = "keep";
    this.use("turn");
  }

  /** The region that says what happens to a part; that of a job has no label. @param {Part} part */
  _regionOf({ name, faces }) {
    return this.control.regions.find((region) => !isPart(region.action) && (region.label === name || JSON.stringify(region.faces) === JSON.stringify(faces)));
  }

  /** What happens to a part; empty: nothing is said. @param {Part} part */
  actionOf(part) {
    const region = this._regionOf(part);
    return region ? String(region.action ?? "keep") : "";
  }

  /** Say what happens to a part, or no more. @param {Part} part @param {string} action */
  mark(part, action) {
    const region = this._regionOf(part);
    this.control.regions = this.control.regions.filter((each) => each !== region);
    if (region && (region.action ?? "keep") === action) this._structure();
    else this.addRegion({ faces: structuredClone(part.faces), action, label: part.name });
  }

  /** @param {Record<string, any>} region */
  addRegion(region) {
    const { regions } = this.control;
    if (regions.length >= MOST_REGIONS) return announce(`${MOST_REGIONS} regions at most`);
    regions.push(region);
    this._structure();
  }

  /** Put a state of `control` before the last change back. */
  undo() {
    const control = this.history.undo();
    if (!control) return;
    this._take(control);
    announce("Undone");
  }

  /** A pointer took hold of something in the view. */
  begun() {
    this.back = this.history.mark();
  }

  /** What it has changed since then was not meant. */
  dropped() {
    this._take(this.back());
  }

  /** @param {Control} control */
  _take(control) {
    this.control = control;
    this._aimElsewhere();
    this._show();
    this.onChange();
  }

  _clear() {
    this.control = readingOf(this.control);
    this.use("turn");
    this._structure();
    announce("Cleared");
  }

  /** A row came or went. */
  _structure() {
    this._show();
    this.changed();
  }

  /** A value is another one: the step is remembered, and the form told. */
  changed() {
    this.history.add(this.control);
    this.refresh();
    this.onChange();
  }

  /** Show the values again, as they change under the pointer. */
  refresh() {
    this.view.draw();
    for (const row of this.rows) row.update();
    this._words();
  }

  _show() {
    const { regions } = this.control;
    const aim = (/** @type {any} */ region) => (/** @type {string} */ action) => {
      region.action = action;
      this._structure();
    };
    const remove = (/** @type {number} */ at) => () => {
      regions.splice(at, 1);
      this._structure();
    };
    this.view.draw();
    this.rows = regions.map((region, at) => regionRow(region, at + 1, this.purposes, aim(region), remove(at)));
    const own = this.rows.filter((_, at) => !isPart(regions[at].action));
    fill(this.lists, own.length ? h("ul", { class: "control-rows", "aria-label": "Regions" }, own.map(({ element }) => element)) : null);
    this.bar.offer(this.purposes, this.action);
    this.symmetry.value = this.control.symmetry;
    this._words();
  }

  _words() {
    this.count.textContent = isEmpty(this.control) ? "" : "· in use";
    this.undoButton.disabled = !this.history.past.length;
    this.clearButton.disabled = isEmpty(this.control) && !unaimed(this.control.regions).length;
    this.bar.show(this.tool, this.view.numbered, !this.undoButton.disabled);
    this.showBrush();
    this.reader?.press();
    say(this.problem, controlProblem(this.control, this.subdivided) || this.view.problem);
  }

  /** The brush is there while this panel is seen, or a part is painted. */
  showBrush() {
    const seen = this.element?.checkVisibility() && this.element.open;
    this.toolbar.hidden = !this.view.possible || !(seen || (isPart(this.action) && this.tool !== "turn"));
  }

  /** @param {boolean} subdivided Whether the long edges are split first. @returns {boolean} whether it can be sent */
  check(subdivided) {
    this.subdivided = subdivided;
    this._words();
    const good = !controlProblem(this.control, subdivided);
    if (!good) this.element.open = true;
    return good;
  }

  /** Say what the server refuses beside it. @param {any[]} errors @returns {boolean} whether all of them belong here */
  refuse(errors) {
    const own = errors.filter((error) => CONTROL_PARAMS.includes(fieldOf(error)[0]));
    if (!own.length) return false;
    const said = own.map((error) => String(error.msg ?? "Not allowed.")).join(" ");
    if (own.every((error) => READING_PARAMS.includes(fieldOf(error)[0]))) this.reader?.refuse(said);
    else {
      this.element.open = true;
      say(this.problem, said);
    }
    return own.length === errors.length;
  }

  focusProblem() {
    /** @type {HTMLElement | null} */ (this.element.querySelector("summary"))?.focus();
  }
}
