// @ts-check
/** What stays and what goes where: the tools below the view, and the lists in the form. */
import { announce, toast } from "../../announce.js";
import { button, fill, h, labelled, say } from "../../dom.js";
import { placeOf } from "../../groups.js";
import { CONTROL_PARAMS, controlProblem, History, isEmpty, isPart, noControl, noReading, SYMMETRIES, unaimed } from "./model.js";
import { partAction, partOf } from "../parts/naming.js";
import { handleRow, named, partOptions, regionRow } from "./rows.js";
import { Toolbar } from "./toolbar.js";
import { ControlView } from "./view.js";

/** @typedef {import("./model.js").Control} Control */
/** @typedef {import("../../../viewer/control/tools.js").Tool} Tool */
/** @typedef {import("./rows.js").Named} Named */
/** @typedef {import("./rows.js").Parts} Parts */

/** @type {Parts} */
const NO_PARTS = { nodes: [], materials: [], mesh_names: [] };
const MOST_REGIONS = 64;

export class ControlPanel {
  /** @param {import("../../viewer-box.js").ViewerBox} box @param {() => void} onChange */
  constructor(box, onChange) {
    this.onChange = onChange;
    this.control = noControl();
    this.history = new History(this.control);
    this.back = this.history.mark();
    /** Name and size of the file that the regions and handles are for. */
    this.of = "";
    /** That which is shown. */
    this.asset = "";
    /** @type {Parts} */
    this.parts = NO_PARTS;
    this.offered = "";
    /** @type {Tool} */
    this.tool = "turn";
    this.action = "keep";
    this.erasing = false;
    this.picking = "node";
    this.subdivided = false;
    /** The region whose box is in the view, and the handle that was touched last. */
    this.boxed = -1;
    this.chosen = -1;
    /** @type {import("./rows.js").Row[]} */
    this.rows = [];
    /** What shows how the asset is read. @type {{press: () => void, refuse: (text: string) => void} | null} */
    this.reader = null;
    this.view = new ControlView(box, this);
    this.lists = h("div", { class: "control-lists" });
    this.problem = h("p", { class: "field-problem", role: "status", hidden: true });
    this.undoButton = button("Undo", () => this.undo(), { class: "chip chip-small" });
    this.clearButton = button("Clear all", () => this._clear(), { class: "chip chip-small" });
    this.count = h("span", { class: "small muted" });
    this.part = h("select", { id: "control-part", "aria-label": "Part to add" });
    this.falloff = h("input", { type: "text", id: "control-falloff", inputmode: "decimal", autocomplete: "off", placeholder: "0.1", "aria-describedby": "control-falloff-help" });
    this.symmetry = h("select", { id: "control-symmetry" }, SYMMETRIES.map(([value, text]) => h("option", { value }, text)));
    this.bar = new Toolbar(this);
    this.toolbar = this.bar.element;
    this.element = this._fold();
    this._show();
  }

  _fold() {
    const add = h(
      "div",
      { class: "chips" },
      button("Add a box", () => this.addBox(), { class: "chip" }),
      button("Add triangles", () => this.addRegion({ faces: [], action: this.action }), { class: "chip" }),
      button("Add a handle", () => this.addHandle(this.view.top), { class: "chip" }),
    );
    const addPart = button("Add part", () => this._addPart(), { class: "chip" });
    this.partRow = h("div", { class: "row part-row", hidden: true }, this.part, addPart);
    const help = h("p", { class: "small muted", id: "control-falloff-help" }, "How far the surface bends to join what is kept, as a share of the asset's diagonal.");
    this.falloffRow = labelled("control-falloff", "Fall-off", this.falloff, help);
    this.falloffRow.hidden = true;
    this.falloff.addEventListener("input", () => {
      this.control.falloff = this.falloff.value;
      this.changed();
    });
    this.symmetry.addEventListener("change", () => {
      this.control.symmetry = this.symmetry.value;
      this.changed();
    });
    const fold = h(
      "details",
      { class: "advanced control-panel" },
      h("summary", null, "Control ", this.count),
      h("p", { class: "small muted" }, "Choose parts that stay, and places for others."),
      add,
      this.partRow,
      this.lists,
      this.falloffRow,
      this.problem,
      h("div", { class: "row" }, this.undoButton, this.clearButton),
      labelled("control-symmetry", "Symmetry", this.symmetry),
    );
    fold.addEventListener("toggle", () => this._place());
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
    this.boxed = this.chosen = -1;
    this._aimElsewhere();
    this._belong();
    this.history.reset(this.control);
    if (!isEmpty(this.control)) /** @type {HTMLDetailsElement} */ (this.element).open = true;
    this._show();
  }

  /** Say which file is shown. @param {string} key */
  assetIs(key) {
    if (this.asset !== key) this.offer(NO_PARTS);
    this.asset = key;
    if (!this.of) this.of = key;
    this._belong();
  }

  /** Nothing that was said about another file holds for the one that is shown. */
  _belong() {
    if (!this.asset || this.of === this.asset) return;
    this.of = this.asset;
    const { regions, handles, noun, names } = this.control;
    if (!regions.length && !handles.length && !noun && !names.length) return;
    Object.assign(this.control, { ...noReading(), regions: [], handles: [] });
    this.history.reset(this.control);
    this._show();
    toast(`${regions.length + handles.length ? "Regions and handles" : "Corrections"} belonged to the other file, and are removed`);
  }

  /** @param {Parts} parts What the asset names, as the server lists it. */
  offer({ nodes, materials, mesh_names }) {
    const parts = { nodes, materials, mesh_names };
    const text = JSON.stringify(parts);
    if (text === this.offered) return;
    this.offered = text;
    this.parts = parts;
    const chosen = this.part.value;
    fill(this.part, partOptions(parts));
    if (chosen) this.part.value = chosen;
    if (this.partRow) this.partRow.hidden = parts.nodes.length + parts.materials.length < 1;
    this.view.draw();
  }

  /** @param {Tool} tool */
  use(tool) {
    this.tool = tool;
    this.bar.take(tool);
    const same = (/** @type {any} */ region) => region?.box && (isPart(this.action) ? region.action === this.action : !isPart(region.action));
    if (tool === "box" && !same(this.control.regions[this.boxed])) {
      this.boxed = this.control.regions.findLastIndex(same);
      if (this.boxed < 0) this.addBox();
    }
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

  addBox() {
    this.addRegion({ box: this.view.firstBox, action: this.action });
    if (this.view.possible) this.use("box");
  }

  _addPart() {
    if (this.part.value) this.addRegion({ ...JSON.parse(this.part.value), action: this.action });
  }

  /** @param {Record<string, any>} region @returns {number} its place in the list */
  addRegion(region) {
    const { regions } = this.control;
    if (regions.length >= MOST_REGIONS) {
      announce(`${MOST_REGIONS} regions at most`);
      return regions.length - 1;
    }
    regions.push(region);
    if (region.box) this.boxed = regions.length - 1;
    this._structure();
    return regions.length - 1;
  }

  /** @param {number[]} position @returns {number} its place in the list */
  addHandle(position) {
    this.control.handles.push({ position: [...position], to: [...position] });
    this.chosen = this.control.handles.length - 1;
    this._structure();
    return this.chosen;
  }

  /** @param {import("../../../viewer/control/surface.js").Part} part That was clicked. */
  pick(part) {
    const [kind, list] = /** @type {["node" | "material", Named[]]} */ (this.picking === "material" ? ["material", this.view.named.materials] : ["node", this.view.named.nodes]);
    const index = part[kind];
    if (index === null || index < 0) return announce(`This part has no ${kind} that is known`);
    const name = named(list.find((found) => found.index === index) ?? { index, name: "" }, list);
    const at = this.control.regions.findIndex((region) => region[kind] === name && (region.action ?? "keep") === this.action);
    if (at >= 0) this._remove("regions", at);
    else this.addRegion({ [kind]: name, action: this.action });
    announce(`${kind} ${name} ${at >= 0 ? "removed" : "added"}`);
  }

  /** Put a state of `control` before the last change back. */
  undo() {
    const control = this.history.undo();
    if (!control) return;
    this.history.amend(control);
    this.boxed = -1;
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
    this.chosen = -1;
    this._aimElsewhere();
    this._show();
    this.onChange();
  }

  _clear() {
    const { noun, names, regions } = this.control;
    this.control = { ...noControl(), noun, names, regions: regions.filter(({ action }) => isPart(action)) };
    this.boxed = this.chosen = -1;
    this.use("turn");
    this._structure();
    announce("Cleared");
  }

  /** @param {"regions" | "handles"} list @param {number} at */
  _remove(list, at) {
    this.control[list].splice(at, 1);
    if (list === "regions") this.boxed = this.boxed === at ? -1 : this.boxed > at ? this.boxed - 1 : this.boxed;
    else this.chosen = -1;
    this._structure();
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
    const { regions, handles } = this.control;
    this.view.draw();
    const region = (/** @type {any} */ each, /** @type {number} */ at) =>
      regionRow(each, at + 1, {
        changed: () => this.changed(),
        moved: () => this._structure(),
        purposes: this.purposes,
        remove: () => this._remove("regions", at),
        edit: this.view.possible ? () => ((this.boxed = at), (this.action = each.action ?? "keep"), this.use("box")) : null,
        selected: () => this.view.selected(at),
      });
    const handle = (/** @type {any} */ each, /** @type {number} */ at) => handleRow(each, at + 1, () => this.changed(), () => this._remove("handles", at));
    const rows = regions.map(region);
    const own = [...rows.filter((_, at) => !isPart(regions[at].action)), ...handles.map(handle)];
    this.rows = [...rows, ...own.slice(own.length - handles.length)];
    fill(this.lists, own.length ? h("ul", { class: "control-rows", "aria-label": "Regions and handles" }, own.map(({ element }) => element)) : null);
    this.bar.offer(this.purposes, this.action);
    this.falloff.value = this.control.falloff;
    this.symmetry.value = this.control.symmetry;
    this._words();
  }

  _words() {
    const { regions } = this.control;
    const { tool } = this;
    this.count.textContent = isEmpty(this.control) ? "" : "· in use";
    this.undoButton.disabled = !this.history.past.length;
    this.clearButton.disabled = isEmpty(this.control) && !unaimed(regions).length;
    if (this.falloffRow) this.falloffRow.hidden = !regions.length;
    this.bar.show(tool, this.view.numbered, !this.undoButton.disabled);
    this._place();
    this.reader?.press();
    const problem = controlProblem(this.control, this.subdivided) || this.view.problem;
    say(this.problem, problem);
  }

  /** The tools are there while this panel is open, or the regions of a prompt are edited. */
  _place() {
    const { open } = /** @type {HTMLDetailsElement} */ (this.element ?? {});
    this.toolbar.hidden = !this.view.possible || !(open || (isPart(this.action) && this.tool !== "turn"));
  }

  /** @param {boolean} subdivided Whether the long edges are split first. @returns {boolean} whether it can be sent */
  check(subdivided) {
    this.subdivided = subdivided;
    this._words();
    const wrong = this.element.querySelector('[aria-invalid="true"]');
    const good = !wrong && !controlProblem(this.control, subdivided);
    if (!good) /** @type {HTMLDetailsElement} */ (this.element).open = true;
    return good;
  }

  /** Say what the server refuses beside it. @param {any[]} errors @returns {boolean} whether all of them belong here */
  refuse(errors) {
    const own = errors.filter((error) => CONTROL_PARAMS.includes(placeOf(error)[0]));
    if (!own.length) return false;
    const said = own.map((error) => String(error.msg ?? "Not allowed.")).join(" ");
    if (own.every((error) => ["source_noun", "parts"].includes(placeOf(error)[0]))) this.reader?.refuse(said);
    else {
      /** @type {HTMLDetailsElement} */ (this.element).open = true;
      say(this.problem, said);
    }
    return own.length === errors.length;
  }

  focusProblem() {
    /** @type {HTMLElement | null} */ (this.element.querySelector('[aria-invalid="true"]') ?? this.element.querySelector("summary"))?.focus();
  }
}
