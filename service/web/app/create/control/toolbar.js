// @ts-check
/** The brush, below the view: whether it is in hand, what it paints, and how large it is. */
import { button, fill, h } from "../../dom.js";
import { choose, segmented, slider } from "../../widgets.js";

/** @typedef {import("../../../viewer/control/tools.js").Tool} Tool */

const TOOLS = /** @type {[Tool, string][]} */ ([["turn", "Turn"], ["paint", "Paint"]]);
const HINT = "Drag on the asset to paint. Beside it, dragging turns the view.";
const TOUCHED = matchMedia("(any-pointer: coarse)");

export class Toolbar {
  /** @param {import("./panel.js").ControlPanel} panel */
  constructor(panel) {
    this.panel = panel;
    this.tools = segmented("Tool", TOOLS, "turn", (tool) => panel.use(/** @type {Tool} */ (tool)));
    const strokes = segmented("Brush", [["add", "Add"], ["erase", "Erase"]], "add", (stroke) => (panel.erasing = stroke === "erase"));
    this.purposes = h("div", null);
    this.hint = h("p", { class: "small muted tool-hint", "aria-live": "polite" });
    this.brush = h("div", { class: "row tool-row" }, this.purposes, strokes, this._size());
    this.undo = button("Undo", () => panel.undo(), { icon: "retry", quiet: true, class: "button-quiet", title: "Undo (Ctrl+Z)" });
    this.element = h(
      "div",
      { class: "control-tools", hidden: true, role: "group", "aria-label": "Control in the view" },
      h("div", { class: "row tool-row" }, this.tools, this.undo),
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
    size.value.textContent = "5%";
    size.input.setAttribute("aria-label", "Size of the brush, percent of the asset's diagonal");
    return size.row;
  }

  /** Offer what new regions can be for. @param {[string, string][]} purposes @param {string} chosen */
  offer(purposes, chosen) {
    fill(this.purposes, segmented("New regions", purposes, chosen, (action) => void (this.panel.action = action)));
  }

  /** @param {Tool} tool That is in hand. @param {boolean} numbered Whether faces can be pointed at. @param {boolean} undoable */
  show(tool, numbered, undoable) {
    choose(this.tools, tool);
    this.undo.disabled = !undoable;
    this.brush.hidden = this.hint.hidden = tool === "turn";
    this.hint.textContent = numbered ? `${HINT}${TOUCHED.matches ? " Two fingers turn and zoom the view." : ""}` : "The triangles of this file cannot be numbered here: use a GLB.";
  }
}
