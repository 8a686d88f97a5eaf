// @ts-check
/** The tools below the view: which is in hand, what new regions are for, and the brush. */
import { button, fill, h } from "../../dom.js";
import { segmented, slider } from "../../job/stage-controls.js";

/** @typedef {import("../../../viewer/control/tools.js").Tool} Tool */

const TOOLS = /** @type {[Tool, string][]} */ ([["turn", "Turn"], ["paint", "Paint"], ["box", "Box"], ["part", "Part"], ["handle", "Handle"]]);
const HINTS = /** @type {Record<Tool, string>} */ ({
  turn: "",
  paint: "Drag on the asset to paint. Beside it, dragging turns the view.",
  box: "Drag the points on the sides of the box.",
  part: "Click a part of the asset.",
  handle: "Drag a point of the asset to where it should be.",
});
const TOUCHED = matchMedia("(any-pointer: coarse)");

export class Toolbar {
  /** @param {import("./panel.js").ControlPanel} panel */
  constructor(panel) {
    this.panel = panel;
    this.tools = segmented("Tool", TOOLS, "turn", (tool) => panel.use(/** @type {Tool} */ (tool)));
    const strokes = segmented("Brush", [["add", "Add"], ["erase", "Erase"]], "add", (stroke) => (panel.erasing = stroke === "erase"));
    this.purposes = h("div", null);
    this.by = segmented("Parts by", [["node", "Nodes"], ["material", "Materials"]], "node", (by) => (panel.picking = by));
    this.hint = h("p", { class: "small muted tool-hint", "aria-live": "polite" });
    this.brush = h("div", { class: "row tool-row" }, strokes, this._size());
    this.undo = button("Undo", () => panel.undo(), { icon: "retry", quiet: true, class: "button-quiet", title: "Undo (Ctrl+Z)" });
    this.element = h(
      "div",
      { class: "control-tools", hidden: true, role: "group", "aria-label": "Control in the view" },
      h("div", { class: "row tool-row" }, this.tools, this.undo),
      h("div", { class: "row tool-row" }, this.purposes, this.by),
      this.brush,
      this.hint,
    );
  }

  /** The slider of the brush's size. */
  _size() {
    const size = slider("brush-slider", "Size", 30, () => {
      this.panel.view.brush = Number(size.input.value) / 100;
      size.value.textContent = `${size.input.value}%`;
    });
    size.input.min = "1";
    size.input.value = "5";
    size.row.hidden = false;
    size.value.textContent = "5%";
    size.input.setAttribute("aria-label", "Size of the brush, percent of the asset's diagonal");
    return size.row;
  }

  /** @param {Tool} tool That is in hand. */
  take(tool) {
    const input = this.tools.querySelectorAll("input")[TOOLS.findIndex(([name]) => name === tool)];
    if (input) input.checked = true;
  }

  /** Offer what new regions can be for. @param {[string, string][]} purposes @param {string} chosen */
  offer(purposes, chosen) {
    const { panel } = this;
    const choice = segmented("New regions", purposes, chosen, (action) => void (panel.action = action));
    fill(this.purposes, choice);
  }

  /** @param {Tool} tool That is in hand. @param {boolean} numbered Whether faces can be pointed at. @param {boolean} undoable */
  show(tool, numbered, undoable) {
    this.undo.disabled = !undoable;
    this.purposes.hidden = !["paint", "box", "part"].includes(tool);
    this.by.hidden = tool !== "part";
    this.brush.hidden = tool !== "paint";
    const fingers = tool !== "turn" && TOUCHED.matches ? " Two fingers turn and zoom the view." : "";
    this.hint.textContent = numbered || tool === "turn" ? `${HINTS[tool]}${fingers}` : "The triangles of this file cannot be numbered here: use a GLB, or type a box.";
    this.hint.hidden = !this.hint.textContent;
  }
}
