// @ts-check
/** The parts of an asset, in words. */
import { h } from "../../dom.js";

/** @typedef {{index: number, name: string}} Named */
/** @typedef {{nodes: Named[], materials: Named[], mesh_names: Named[]}} Parts */

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
