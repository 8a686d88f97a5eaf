// @ts-check
/**
 * What a request says about where its asset may deform, as the form edits it: regions and symmetry; and what its asset is,
 * where a person said so.
 * No elements here, so that node can test it.
 *
 * @typedef {Record<string, any>} Region `label`: the part that it was made of, which is said here alone.
 * @typedef {{regions: Region[], symmetry: string, noun: string, front: string, names: import("../parts/naming.js").Naming[]}} Control `regions`:
 *   those of parts, too. `front`: degrees, or as the API names it; empty: as the asset is read.
 */
import { counted } from "../../format.js";
import { partOf, partParams, partsAsked } from "../parts/naming.js";

/** The parameters that the form edits. */
export const CONTROL_PARAMS = ["regions", "symmetry", "source_noun", "orientation", "parts"];
/** Those of them that say what the asset is. */
export const READING_PARAMS = ["source_noun", "orientation", "parts"];
export const SYMMETRIES = /** @type {[string, string][]} */ ([
  ["none", "Not kept"],
  ["auto", "Where the asset has one"],
  ["x", "Left and right (x)"],
  ["y", "Top and bottom (y)"],
  ["z", "Front and back (z)"],
]);

/** @returns {Control} */
export function noControl() {
  return { regions: [], symmetry: "none", noun: "", front: "", names: [] };
}

/** Whether nothing is said but what the asset is. @param {Control} control */
export function isEmpty(control) {
  return !Object.keys(controlParams({ ...noControl(), symmetry: control.symmetry, regions: unaimed(control.regions) })).length;
}

/** Only what was said of what the asset is. @param {Control} control @returns {Control} */
export function readingOf({ regions, noun, front, names }) {
  return { ...noControl(), noun, front, names, regions: regions.filter(({ action }) => isPart(action)) };
}

/** Whether a region is a part, and says nothing about what may move. @param {string | undefined} action */
export function isPart(action) {
  return partOf(action) !== null;
}

/** @param {Region[]} regions @returns {Region[]} those that say what may move */
export function unaimed(regions) {
  return regions.filter(({ action }) => !isPart(action));
}

/** The parameters of a request. @param {Control} control @returns {Record<string, any>} */
export function controlParams({ regions, symmetry, noun, front, names }) {
  // A region that is still to be painted selects nothing.
  const chosen = unaimed(regions).filter((region) => !region.faces || region.faces.length);
  const parts = partParams(names, regions);
  return {
    ...(chosen.length ? { regions: chosen.map(({ label: _, ...region }) => region) } : {}),
    ...(symmetry !== "none" ? { symmetry } : {}),
    ...(noun ? { source_noun: noun } : {}),
    ...(front !== "" ? { orientation: Number.isFinite(Number(front)) ? Number(front) : front } : {}),
    ...(parts.length ? { parts } : {}),
  };
}

/** @param {Record<string, any>} params Of a job. @returns {Control} */
export function controlOf(params) {
  const parts = partsAsked((params.parts ?? []).map(withoutNulls));
  return structuredClone({
    regions: [...(params.regions ?? []), ...parts.regions].map(withoutNulls),
    symmetry: params.symmetry ?? "none",
    noun: String(params.source_noun ?? ""),
    front: String(params.orientation ?? ""),
    names: parts.names,
  });
}

/** @param {Record<string, any>} document */
function withoutNulls(document) {
  return Object.fromEntries(Object.entries(document).filter(([, value]) => value !== null));
}

/** @param {Region} region What it is, in words. */
export function regionWords({ label, faces, action: _, ...others }) {
  if (!faces) return Object.entries(others).map(([name, value]) => `${name} ${typeof value === "object" ? "" : value}`.trim()).join(", ");
  return label ? `The ${label}` : `Painted, ${counted(faceCount(faces), "triangle")}`;
}

/** @param {(number | [number, number])[]} faces */
function faceCount(faces) {
  return faces.reduce((/** @type {number} */ sum, item) => sum + (Array.isArray(item) ? item[1] - item[0] + 1 : 1), 0);
}

/**
 * What cannot be sent, in a sentence; empty where all is fine.
 * @param {Control} control
 * @param {boolean} subdivided Whether the long edges are split first, which numbers the triangles anew.
 */
export function controlProblem({ regions }, subdivided) {
  return subdivided && regions.some(({ faces }) => faces?.length) ? "Triangles are numbered as in the file: nothing can be painted or kept by its part while long edges are split first." : "";
}

/** Past states of a document, for Undo. */
export class History {
  /** @param {Control} now */
  constructor(now) {
    /** @type {string[]} */
    this.past = [];
    this.now = JSON.stringify(now);
  }

  /** Remember a state as one step, if it is another one. @param {Control} control */
  add(control) {
    const text = JSON.stringify(control);
    if (text === this.now) return;
    this.past.push(this.now);
    if (this.past.length > 100) this.past.shift();
    this.now = text;
  }

  /** @returns {Control | null} The state before the last step; null where there is none. */
  undo() {
    const text = this.past.pop();
    if (text === undefined) return null;
    this.now = text;
    return JSON.parse(text);
  }

  /** @returns {() => Control} Goes back to the state of now, and forgets the steps until then. */
  mark() {
    const [past, now] = [[...this.past], this.now];
    return () => {
      this.past = past;
      this.now = now;
      return JSON.parse(now);
    };
  }

  /** Begin anew. @param {Control} control */
  reset(control) {
    this.past = [];
    this.now = JSON.stringify(control);
  }
}
