// @ts-check
/**
 * A worker that unfolds a field, so that the page stays quick. A message `{ id, task, ... }` is
 * answered by one with the same `id`, or by `{ id, error }`.
 *
 * @typedef {{ faces: number, vertices: number, bytes: number, readMs: number, levels: number }} Opened
 * @typedef {{ level: number, glb: ArrayBuffer, faces: number, vertices: number, ms: number }} Level
 */
import { writeGlb } from "./glb.js";
import { readField, unfold } from "./ndf.js";

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
    return { faces, vertices: field.header.vertices, bytes: bytes.byteLength, readMs: performance.now() - begin, levels };
  },

  /** @param {{ level: number }} given @returns {Level} */
  level({ level }) {
    const begin = performance.now();
    const made = meshOf(level);
    const ms = performance.now() - begin;
    const { positions, indices } = made;
    return { level, glb: glbOf(positions, indices), faces: indices.length / 3, vertices: positions.length / 3, ms };
  },
};

/** @param {number} level */
function meshOf(level) {
  if (!field) throw new Error("No field is open.");
  if (mesh?.level !== level) mesh = { level, ...unfold(field, level) };
  return mesh;
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
  const chunks = [positions, normals, indices].map((list) => new Uint8Array(list.buffer, list.byteOffset, list.byteLength));
  const offsets = [0, chunks[0].length, 2 * chunks[0].length];
  const count = positions.length / 3;
  const json = {
    asset: { version: "2.0", generator: "Meshdeform" },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0, NORMAL: 1 }, indices: 2 }] }],
    buffers: [{ byteLength: offsets[2] + chunks[2].length }],
    bufferViews: chunks.map((chunk, i) => ({ buffer: 0, byteOffset: offsets[i], byteLength: chunk.length, target: i < 2 ? 34962 : 34963 })),
    accessors: [
      { bufferView: 0, componentType: 5126, count, type: "VEC3", min, max },
      { bufferView: 1, componentType: 5126, count, type: "VEC3" },
      { bufferView: 2, componentType: 5125, count: indices.length, type: "SCALAR" },
    ],
  };
  return writeGlb(json, chunks);
}

addEventListener("message", async ({ data }) => {
  const { id, task, ...given } = data;
  try {
    const found = /** @type {Partial<Level>} */ (await tasks[/** @type {keyof typeof tasks} */ (task)](given));
    self.postMessage({ id, ...found }, { transfer: found.glb ? [found.glb] : [] });
  } catch (error) {
    self.postMessage({ id, error: error instanceof Error ? error.message : String(error) });
  }
});
