// @ts-check
/**
 * What a request says about where its asset may deform, as the form edits it: regions, handles and symmetry; and what its
 * asset is, where a person said so.
 * No elements here, so that node can test it.
 *
 * @typedef {Record<string, any>} Region
 * @typedef {{position?: number[], vertex?: number, to: number[], weight?: number}} Handle
 * @typedef {{regions: Region[], handles: Handle[], symmetry: string, falloff: string, noun: string, names: import("../parts/naming.js").Naming[]}} Control `regions`: those of parts, too. `falloff` as it was typed; empty: as the service decides.
 */
import { counted, figure } from "../../format.js";
import { partOf, partParams, partsAsked } from "../parts/naming.js";

/** The parameters that the panel edits. */
export const CONTROL_PARAMS = ["regions", "handles", "symmetry", "falloff", "source_noun", "parts"];
export const AXES = ["x", "y", "z"];
export const SYMMETRIES = /** @type {[string, string][]} */ ([
  ["none", "Not kept"],
  ["auto", "Where the asset has one"],
  ["x", "Left and right (x)"],
  ["y", "Top and bottom (y)"],
  ["z", "Front and back (z)"],
]);

/** @returns {Control} */
export function noControl() {
  return { regions: [], handles: [], symmetry: "none", falloff: "", noun: "", names: [] };
}

/** Whether nothing is said but what the asset is. @param {Control} control */
export function isEmpty(control) {
  return !Object.keys(controlParams({ ...control, ...noReading(), regions: unaimed(control.regions) })).length;
}

/** Nothing said of what the asset is. */
export function noReading() {
  const { noun, names } = noControl();
  return { noun, names };
}

/** Only what was said of what the asset is. @param {Control} control @returns {Control} */
export function readingOf({ regions, noun, names }) {
  return { ...noControl(), noun, names, regions: regions.filter(({ action }) => partOf(action) !== null) };
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
export function controlParams({ regions, handles, symmetry, falloff, noun, names }) {
  // A box or a painted region that is still empty selects nothing.
  const chosen = unaimed(regions).filter((region) => !region.faces || region.faces.length);
  const parts = partParams(names, regions);
  return {
    ...(chosen.length ? { regions: chosen } : {}),
    ...(handles.length ? { handles } : {}),
    ...(symmetry !== "none" ? { symmetry } : {}),
    ...(chosen.length && falloff.trim() !== "" && !falloffProblem(falloff) ? { falloff: Number(falloff) } : {}),
    ...(noun ? { source_noun: noun } : {}),
    ...(parts.length ? { parts } : {}),
  };
}

/** @param {Record<string, any>} params Of a job. @returns {Control} */
export function controlOf(params) {
  const parts = partsAsked((params.parts ?? []).map(withoutNulls));
  return structuredClone({
    regions: [...(params.regions ?? []), ...parts.regions].map(withoutNulls),
    handles: (params.handles ?? []).map(withoutNulls),
    symmetry: params.symmetry ?? "none",
    falloff: params.falloff === undefined || params.falloff === null ? "" : String(params.falloff),
    noun: String(params.source_noun ?? ""),
    names: parts.names,
  });
}

/** @param {Record<string, any>} document */
function withoutNulls(document) {
  return Object.fromEntries(Object.entries(document).filter(([, value]) => value !== null));
}

/** @param {Region} region What it is, in words. */
export function regionWords(region) {
  const { faces, box, sphere, capsule, joint, color, component, node, mesh, material } = region;
  if (faces) return `Painted, ${counted(faceCount(faces), "triangle")}`;
  if (box) return "Box";
  if (sphere) return `Sphere of radius ${figure(sphere.radius)}`;
  if (capsule) return `Capsule of radius ${figure(capsule.radius)}`;
  if (joint) return `Joint ${joint.name}, above ${figure(joint.above ?? 0.5)}`;
  if (color) return `Vertex colour ${color.rgb.map(figure).join(", ")}`;
  if (component !== undefined) return `Component ${component}`;
  if (node !== undefined) return `Node ${node}`;
  return material !== undefined ? `Material ${material}` : `Mesh ${mesh}`;
}

/** @param {(number | [number, number])[]} faces */
export function faceCount(faces) {
  return faces.reduce((/** @type {number} */ sum, item) => sum + (Array.isArray(item) ? item[1] - item[0] + 1 : 1), 0);
}

/** @param {(number | [number, number])[]} faces As they are typed: "0-12, 40". */
export function facesText(faces) {
  return faces.map((item) => (Array.isArray(item) ? item.join("-") : item)).join(", ");
}

/** @param {string} text @returns {(number | [number, number])[] | null} Null where it is no list of numbers and ranges. */
export function facesOf(text) {
  const items = text.split(/[\s,]+(?!-)/).filter(Boolean);
  /** @type {(number | [number, number])[]} */
  const found = [];
  for (const item of items) {
    const match = /^(\d+)(?:-(\d+))?$/.exec(item);
    if (!match || (match[2] !== undefined && Number(match[2]) < Number(match[1]))) return null;
    found.push(match[2] === undefined ? Number(match[1]) : [Number(match[1]), Number(match[2])]);
  }
  return found;
}

/** What is wrong with a fall-off; empty where it is fine. @param {string} text */
export function falloffProblem(text) {
  const value = Number(text);
  if (text.trim() === "") return "";
  return Number.isFinite(value) && value >= 0 && value <= 1 ? "" : "Enter a number from 0 to 1.";
}

/**
 * What cannot be sent, in a sentence; empty where all is fine.
 * @param {Control} control
 * @param {boolean} subdivided Whether the long edges are split first, which numbers the triangles anew.
 */
export function controlProblem({ regions, handles, falloff }, subdivided) {
  const painted = regions.some(({ faces }) => faces?.length) || handles.some(({ vertex }) => vertex !== undefined);
  if (subdivided && painted) return "Painted triangles are numbered as in the file: they cannot be used with long edges split first. Use a box or a part.";
  for (const { box } of regions) {
    const axis = box ? AXES[[0, 1, 2].findIndex((i) => box.min[i] > box.max[i])] : undefined;
    if (axis) return `A box ends before it begins along ${axis}.`;
  }
  return falloffProblem(falloff);
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

  /** Take another state as the present one, without a step. @param {Control} control */
  amend(control) {
    this.now = JSON.stringify(control);
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
