// @ts-check
/** The tools below the view, and the parts of an asset, in words. */
import { h } from "../../dom.js";
import { slider } from "../../job/stage-controls.js";

/** @typedef {import("../../../viewer/control/tools.js").Tool} Tool */
/** @typedef {{index: number, name: string}} Named */
/** @typedef {{nodes: Named[], materials: Named[], mesh_names: Named[]}} Parts */

export const TOOLS = /** @type {[Tool, string][]} */ ([["turn", "Turn"], ["paint", "Paint"], ["box", "Box"], ["part", "Part"], ["handle", "Handle"]]);
export const HINTS = /** @type {Record<Tool, string>} */ ({
  turn: "",
  paint: "Drag on the asset to paint. Beside it, dragging turns the view.",
  box: "Drag the points on the sides of the box.",
  part: "Click a part of the asset.",
  handle: "Drag a point of the asset to where it shall be.",
});

/** The name of a part, or its number where no name says which it is. @param {Named} part @param {Named[]} all */
export function named(part, all) {
  return part.name && all.filter(({ name }) => name === part.name).length === 1 ? part.name : part.index;
}

/** The parts of an asset, to choose one; a value is a selection as JSON. @param {Parts} parts */
export function partOptions({ nodes, materials }) {
  const group = (/** @type {string} */ kind, /** @type {string} */ label, /** @type {Named[]} */ list) =>
    h("optgroup", { label }, list.map((part) => h("option", { value: JSON.stringify({ [kind]: named(part, list) }) }, part.name || `${kind} ${part.index}`)));
  return [group("node", "Nodes", nodes), group("material", "Materials", materials)];
}

/** The slider of the brush's size. @param {(share: number) => void} set Of the asset's diagonal. */
export function brushSlider(set) {
  const brush = slider("brush-slider", "Size", 30, () => {
    set(Number(brush.input.value) / 100);
    brush.value.textContent = `${brush.input.value}%`;
  });
  brush.input.min = "1";
  brush.input.value = "5";
  brush.row.hidden = false;
  brush.value.textContent = "5%";
  brush.input.setAttribute("aria-label", "Size of the brush, percent of the asset's diagonal");
  return brush.row;
}
