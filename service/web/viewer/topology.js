// @ts-check
/**
 * Which vertex of a result belongs to which of its source. Meshdeform keeps nodes, primitives, vertices and faces in
 * their order, so they are paired by it; where a file was converted (OBJ, STL) the corners of the faces are.
 */
import { meshesOf, primitiveOf } from "./loading.js";
import { tornApart } from "./weld.js";

/**
 * @typedef {object} Pair
 * @property {import("three").Mesh} mesh of the source
 * @property {Float32Array} after (3V) the result's positions in the mesh's own space, in the source's order
 * @property {Float32Array | null} normals (3V)
 * @property {Float32Array | null} tangents (4V)
 * @property {import("three").BufferGeometry["morphAttributes"]} targets of the result
 * @property {string} primitive of the result's file (`primitiveOf`)
 * @property {number} count of the result's vertices
 * @property {ArrayLike<number> | null} order the vertex of the result for each of the source; null: the same
 */

/** The result is not the source with other positions; `code` is "topology". */
export class TopologyError extends Error {
  /** @param {string} message */
  constructor(message) {
    super(`${message} The two can be shown side by side, but not blended.`);
    this.name = "TopologyError";
    this.code = "topology";
  }
}

/**
 * Pair the meshes of a source with those of its result.
 * @param {import("three").Object3D} source
 * @param {import("three").Object3D} result
 * @param {boolean} converted the source is no glTF: its loader may order vertices in another way than the service did
 * @returns {Pair[]}
 * @throws {TopologyError}
 */
export function pairMeshes(source, result, converted) {
  const before = meshesOf(source);
  const after = meshesOf(result);
  if (before.length !== after.length) {
    throw new TopologyError(`The result has ${count(after.length, "mesh", "meshes")}, the source ${before.length}.`);
  }
  return before.map((mesh, i) => pair(mesh, after[i], converted, before.length > 1 ? `mesh ${i + 1}` : "the mesh"));
}

/** @param {import("three").Mesh} mesh @param {import("three").Mesh} other @param {boolean} converted @param {string} name */
function pair(mesh, other, converted, name) {
  const [source, result] = [mesh.geometry, other.geometry];
  const [from, to] = [source.attributes.position, result.attributes.position];
  const order = cornerOrder(source, result);
  if (!order && from.count !== to.count) {
    throw new TopologyError(`In ${name} the result has ${count(to.count, "vertex", "vertices")}, the source ${from.count}.`);
  }
  if (!order && !sameIndex(source, result)) {
    throw new TopologyError(`In ${name} the faces of the result join other vertices than those of the source.`);
  }
  const after = floats(to, 3, order);
  if (order || converted) {
    const before = floats(from, 3, null);
    const { torn, shared } = tornApart(before, after, 1e-4 * extent(after));
    if (torn > 0.02 * shared) throw new TopologyError(`In ${name} the vertices of the result are in another order.`);
  }
  const optional = (/** @type {string} */ attribute, /** @type {number} */ size) =>
    source.attributes[attribute] && result.attributes[attribute]
      ? floats(result.attributes[attribute], size, order)
      : null;
  return { mesh, after, normals: optional("normal", 3), tangents: optional("tangent", 4), targets: result.morphAttributes, primitive: primitiveOf(other), count: to.count, order };
}

/**
 * Where the source has three vertices for each face and the result an index, the index says which is which.
 * @param {import("three").BufferGeometry} source
 * @param {import("three").BufferGeometry} result
 * @returns {ArrayLike<number> | null} null: vertex i is vertex i
 */
function cornerOrder(source, result) {
  const corners = source.attributes.position.count;
  return !source.index && result.index && result.index.count === corners ? result.index.array : null;
}

/** @param {import("three").BufferGeometry} a @param {import("three").BufferGeometry} b */
function sameIndex(a, b) {
  if (!a.index || !b.index) return !a.index === !b.index;
  if (a.index.count !== b.index.count) return false;
  for (let i = 0; i < a.index.count; i++) if (a.index.array[i] !== b.index.array[i]) return false;
  return true;
}

/**
 * An attribute as plain floats: interleaved, quantized and normalized ones too.
 * @param {import("three").BufferAttribute | import("three").InterleavedBufferAttribute} attribute
 * @param {number} size components
 * @param {ArrayLike<number> | null} order
 * @returns {Float32Array}
 */
export function floats(attribute, size, order) {
  const length = order ? order.length : attribute.count;
  const out = new Float32Array(size * length);
  for (let i = 0; i < length; i++) {
    const row = order ? order[i] : i;
    for (let c = 0; c < size; c++) out[size * i + c] = attribute.getComponent(row, c);
  }
  return out;
}

/** @param {Float32Array} positions @returns {number} its largest coordinate, roughly the mesh's size */
function extent(positions) {
  let largest = 0;
  for (const value of positions) largest = Math.max(largest, Math.abs(value));
  return largest;
}

/** @param {number} number @param {string} one @param {string} many */
function count(number, one, many) {
  return `${number} ${number === 1 ? one : many}`;
}
