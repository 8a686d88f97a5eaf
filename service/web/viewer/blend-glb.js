// @ts-check
/** A GLB between a source and its result: the result's file with blended positions and normals. */
import { readJson, withJson } from "./glb.js";

/** @typedef {{ POSITION: Float32Array, NORMAL?: Float32Array, TANGENT?: Float32Array }} Vertices attributes of one primitive */

const SIZES = /** @type {Record<string, number>} */ ({ VEC3: 3, VEC4: 4 });
/** The kinds of numbers: how a `DataView` names them, how many bytes one has, and which of them stands for 1. */
const KINDS = /** @type {Record<number, { name: "Int8" | "Uint8" | "Int16" | "Uint16" | "Float32", bytes: number, largest: number }>} */ ({
  5120: { name: "Int8", bytes: 1, largest: 127 },
  5121: { name: "Uint8", bytes: 1, largest: 255 },
  5122: { name: "Int16", bytes: 2, largest: 32767 },
  5123: { name: "Uint16", bytes: 2, largest: 65535 },
  5126: { name: "Float32", bytes: 4, largest: 1 },
});

/**
 * Blend the vertices of a result with those of its source.
 * @param {ArrayBuffer} result a GLB
 * @param {Vertices[]} source one for each primitive of the result, in the order of its nodes
 * @param {number} share 0 is the source, 1 the result
 * @returns {ArrayBuffer} a GLB
 * @throws {Error} the two do not fit, or the file is compressed; the message is for people
 */
export function blendGlb(result, source, share) {
  const json = readJson(result);
  const found = primitivesOf(json);
  if (found.length !== source.length) throw new Error("The result has other meshes than the source.");
  const bytes = result.slice(0);
  /** @type {Set<number>} */
  const done = new Set();
  found.forEach((primitive, i) => {
    for (const name of /** @type {(keyof Vertices)[]} */ (["POSITION", "NORMAL", "TANGENT"])) {
      const index = primitive.attributes[name];
      const before = source[i][name];
      if (index === undefined || !before || done.has(index)) continue;
      done.add(index);
      blend(bytes, json, index, before, share, name);
    }
  });
  return withJson(bytes, json);
}

/** The vertices of a GLB, a member for each primitive. @param {ArrayBuffer} buffer @returns {Vertices[]} @throws {Error} they are compressed */
export function verticesOf(buffer) {
  const json = readJson(buffer);
  return primitivesOf(json).map(({ attributes }) => {
    const names = ["POSITION", "NORMAL", "TANGENT"].filter((name) => attributes[name] !== undefined);
    return /** @type {Vertices} */ (Object.fromEntries(names.map((name) => [name, values(buffer, json, attributes[name])])));
  });
}

/**
 * The primitives of the scene's nodes, depth first: a mesh of several nodes comes several times, as some results have it.
 * @param {Record<string, any>} json
 * @returns {{ attributes: Record<string, number>, indices?: number }[]}
 */
export function primitivesOf(json) {
  const visit = (/** @type {number} */ index) => {
    const { mesh, children = [] } = json.nodes[index];
    const own = mesh === undefined ? [] : json.meshes[mesh].primitives;
    return [...own, ...children.flatMap(visit)];
  };
  return (json.scenes?.[json.scene ?? 0]?.nodes ?? []).flatMap(visit);
}

/**
 * @param {ArrayBuffer} bytes changed in place
 * @param {Record<string, any>} json its `min` and `max` of positions are changed in place
 * @param {number} index
 * @param {Float32Array} before
 * @param {number} share
 * @param {string} name
 */
function blend(bytes, json, index, before, share, name) {
  const accessor = json.accessors[index];
  const after = values(bytes, json, index);
  if (after.length !== before.length) throw new Error("The result has other vertices than the source.");
  const size = SIZES[accessor.type];
  for (let i = 0; i < after.length; i++) {
    if (size === 3 || i % 4 !== 3) after[i] = before[i] + share * (after[i] - before[i]);
  }
  if (name !== "POSITION") normalize(after, size);
  const { start, stride, view } = place(bytes, json, index);
  const kind = KINDS[accessor.componentType];
  const largest = accessor.normalized ? kind.largest : 1;
  const stored = kind.name === "Float32" ? after : after.map((value) => Math.round(value * largest));
  const write = /** @type {const} */ (`set${kind.name}`);
  for (let i = 0; i < stored.length; i++) view[write](start + Math.floor(i / size) * stride + kind.bytes * (i % size), stored[i], true);
  if (name !== "POSITION") return;
  accessor.min = [Infinity, Infinity, Infinity];
  accessor.max = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < stored.length; i++) {
    accessor.min[i % 3] = Math.min(accessor.min[i % 3], stored[i]);
    accessor.max[i % 3] = Math.max(accessor.max[i % 3], stored[i]);
  }
}

/** @param {Float32Array} vectors @param {number} size of each; only its first three numbers have a length */
function normalize(vectors, size) {
  for (let i = 0; i < vectors.length; i += size) {
    const length = Math.hypot(vectors[i], vectors[i + 1], vectors[i + 2]) || 1;
    for (let c = 0; c < 3; c++) vectors[i + c] /= length;
  }
}

/** An accessor's numbers as floats. @param {ArrayBuffer} buffer @param {Record<string, any>} json @param {number} index @returns {Float32Array} */
function values(buffer, json, index) {
  const { count, type, componentType, normalized } = json.accessors[index];
  const { start, stride, view } = place(buffer, json, index);
  const size = SIZES[type];
  const kind = KINDS[componentType];
  const read = /** @type {const} */ (`get${kind.name}`);
  const out = new Float32Array(size * count);
  for (let i = 0; i < out.length; i++) {
    const value = view[read](start + Math.floor(i / size) * stride + kind.bytes * (i % size), true);
    out[i] = normalized ? Math.max(value / kind.largest, -1) : value;
  }
  return out;
}

/** @param {ArrayBuffer} buffer @param {Record<string, any>} json @param {number} index where an accessor's bytes are */
export function place(buffer, json, index) {
  const { bufferView, byteOffset = 0, componentType, type, sparse } = json.accessors[index];
  const held = json.bufferViews?.[bufferView];
  if (!held || sparse || held.buffer !== 0 || Object.keys(held.extensions ?? {}).length || !KINDS[componentType] || !SIZES[type]) {
    throw new Error("The file is compressed: only whole steps of it can be downloaded.");
  }
  const view = new DataView(buffer);
  const chunk = 20 + view.getUint32(12, true) + 8;
  const size = KINDS[componentType].bytes * SIZES[type];
  return { start: chunk + (held.byteOffset ?? 0) + byteOffset, stride: held.byteStride ?? size, size, view };
}
