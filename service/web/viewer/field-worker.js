// @ts-check
/**
 * A worker that unfolds a field and computes on it, so that the page stays quick. A message `{ id, task, ... }` is
 * answered by one with the same `id`, or by `{ id, error }`.
 *
 * @typedef {{ faces: number, vertices: number, bytes: number, readMs: number, levels: number, scalars: Named[] }} Opened
 * @typedef {{ name: string, outputs: number, labels: number[] }} Named Scalars of the field, or pieces with their numbers.
 * @typedef {{ level: number, glb: ArrayBuffer, faces: number, vertices: number, ms: number }} Level
 * @typedef {{ values: Float32Array, source: number[], farthest: number, place: number[], ms: number }} Heat
 * @typedef {{ values: Float32Array, least: number, most: number, ms: number }} Learned `values` of pieces are places in their labels
 */
import { distancesFrom } from "./distances.js";
import { writeGlb } from "./glb.js";
import { readField, scalarsAt, unfold } from "./ndf.js";

const MOST_FACES = 600_000;
const MOST_LEVELS = 6;

/** @type {import("./ndf.js").NeuralField | null} */
let field = null;
/** @type {({ level: number } & import("./ndf-unfold.js").Unfolded) | null} The mesh of the last level. */
let mesh = null;

const tasks = {
  /** @param {{ bytes: ArrayBuffer }} given @returns {Promise<Opened>} */
  async open({ bytes }) {
    const begin = performance.now();
    field = await readField(new Uint8Array(bytes));
    mesh = null;
    const faces = field.faces.length / 3;
    let levels = 0;
    while (levels < MOST_LEVELS && faces * 4 ** (levels + 1) <= MOST_FACES) levels++;
    const scalars = field.scalars.map(({ name, offset, labels }) => ({ name, outputs: labels.length ? 1 : offset.length, labels }));
    return { faces, vertices: field.header.vertices, bytes: bytes.byteLength, readMs: performance.now() - begin, levels, scalars };
  },

  /** @param {{ level: number }} given @returns {Level} */
  level({ level }) {
    const begin = performance.now();
    const made = meshOf(level);
    const ms = performance.now() - begin;
    const { positions, indices } = made;
    return { level, glb: glbOf(positions, indices), faces: indices.length / 3, vertices: positions.length / 3, ms };
  },

  /** Distances from a place on the surface, or from the vertex that is farthest from it. @param {{ level: number, place: number[] }} given @returns {Heat} */
  heat({ level, place }) {
    const { positions, indices } = meshOf(level);
    const begin = performance.now();
    const source = nearest(positions, place);
    const distances = distancesFrom(positions, indices, source);
    const ms = performance.now() - begin;
    let far = source;
    for (let v = 0; v < distances.length; v++) if (Number.isFinite(distances[v]) && distances[v] > distances[far]) far = v;
    const values = Float32Array.from(distances);
    return { values, source: placeOf(positions, source), farthest: values[far], place: placeOf(positions, far), ms };
  },

  /** What the field holds beside its surface, by its place among them. @param {{ level: number, scalars: number, output: number }} given @returns {Learned} */
  scalar({ level, scalars, output }) {
    const { corners, weights } = meshOf(level);
    const begin = performance.now();
    const values = scalarsAt(/** @type {import("./ndf.js").NeuralField} */ (field).scalars[scalars], corners, weights, output);
    return { values, ...rangeOf(values), ms: performance.now() - begin };
  },
};

/** @param {Float32Array} values */
function rangeOf(values) {
  let [least, most] = [Infinity, -Infinity];
  for (const value of values) [least, most] = [Math.min(least, value), Math.max(most, value)];
  return { least, most };
}

/** @param {number} level */
function meshOf(level) {
  if (!field) throw new Error("No field is open.");
  if (mesh?.level !== level) mesh = { level, ...unfold(field, level) };
  return mesh;
}

/** @param {Float32Array} positions @param {number} vertex */
function placeOf(positions, vertex) {
  return Array.from(positions.subarray(3 * vertex, 3 * vertex + 3));
}

/** @param {Float32Array} positions @param {number[]} place @returns {number} a vertex */
function nearest(positions, [x, y, z]) {
  let [best, found] = [Infinity, 0];
  for (let i = 0; i < positions.length; i += 3) {
    const apart = (positions[i] - x) ** 2 + (positions[i + 1] - y) ** 2 + (positions[i + 2] - z) ** 2;
    if (apart >= best) continue;
    best = apart;
    found = i / 3;
  }
  return found;
}

/** @param {Float32Array} positions @param {Uint32Array} indices @returns {ArrayBuffer} with smooth normals */
function glbOf(positions, indices) {
  const normals = new Float32Array(positions.length);
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [3 * indices[i], 3 * indices[i + 1], 3 * indices[i + 2]];
    const [ux, uy, uz] = [positions[b] - positions[a], positions[b + 1] - positions[a + 1], positions[b + 2] - positions[a + 2]];
    const [vx, vy, vz] = [positions[c] - positions[a], positions[c + 1] - positions[a + 1], positions[c + 2] - positions[a + 2]];
    const [nx, ny, nz] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const at of [a, b, c]) {
      normals[at] += nx;
      normals[at + 1] += ny;
      normals[at + 2] += nz;
    }
  }
  const [min, max] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (let i = 0; i < positions.length; i += 3) {
    const size = Math.hypot(normals[i], normals[i + 1], normals[i + 2]);
    if (size > 0) for (let axis = 0; axis < 3; axis++) normals[i + axis] /= size;
    else normals[i + 2] = 1;
    for (let axis = 0; axis < 3; axis++) {
      min[axis] = Math.min(min[axis], positions[i + axis]);
      max[axis] = Math.max(max[axis], positions[i + axis]);
    }
  }
  const parts = [positions, normals, indices].map((list) => new Uint8Array(list.buffer, list.byteOffset, list.byteLength));
  const offsets = [0, parts[0].length, 2 * parts[0].length];
  const count = positions.length / 3;
  const json = {
    asset: { version: "2.0", generator: "Meshdeform" },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0, NORMAL: 1 }, indices: 2 }] }],
    buffers: [{ byteLength: offsets[2] + parts[2].length }],
    bufferViews: parts.map((part, i) => ({ buffer: 0, byteOffset: offsets[i], byteLength: part.length, target: i < 2 ? 34962 : 34963 })),
    accessors: [
      { bufferView: 0, componentType: 5126, count, type: "VEC3", min, max },
      { bufferView: 1, componentType: 5126, count, type: "VEC3" },
      { bufferView: 2, componentType: 5125, count: indices.length, type: "SCALAR" },
    ],
  };
  return writeGlb(json, parts);
}

addEventListener("message", async ({ data }) => {
  const { id, task, ...given } = data;
  try {
    const found = /** @type {Partial<Level & Heat>} */ (await tasks[/** @type {keyof typeof tasks} */ (task)](given));
    const owned = /** @type {ArrayBuffer[]} */ ([found.glb, found.values?.buffer].filter(Boolean));
    self.postMessage({ id, ...found }, { transfer: owned });
  } catch (error) {
    self.postMessage({ id, error: error instanceof Error ? error.message : String(error) });
  }
});
