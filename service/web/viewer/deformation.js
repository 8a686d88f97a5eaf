// @ts-check
/** Source and result of one asset, blended. */
import { BufferAttribute, BufferGeometry, DynamicDrawUsage, Vector3 } from "../vendor/three/three.module.js";
import { floats } from "./topology.js";

/** How far beyond the result a shape can be. */
const MOST = 1.5;

/** @typedef {import("./topology.js").Pair} Pair */

/** A mesh that can be moved between the two. The source's geometry is kept aside and comes back with `dispose`. */
class Blend {
  /** @param {Pair} pair */
  constructor({ mesh, after, normals, tangents, targets, primitive, count, order }) {
    this.mesh = mesh;
    this.primitive = primitive;
    this.count = count;
    this.order = order;
    this.original = mesh.geometry;
    this.geometry = shareGeometry(this.original);
    /** @type {{ name: string, attribute: BufferAttribute, before: Float32Array, after: Float32Array }[]} */
    this.tracks = [];
    this.before = floats(this.original.attributes.position, 3, null);
    this.after = after;
    this.#track("position", 3, this.before, after);
    if (this.original.attributes.normal) {
      const before = floats(this.original.attributes.normal, 3, null);
      this.#track("normal", 3, before, normals ?? normalsOf(after, this.original.index));
    }
    if (this.original.attributes.tangent && tangents) {
      this.#track("tangent", 4, floats(this.original.attributes.tangent, 4, null), tangents);
    }
    this.geometry.morphAttributes = bothTargets(this.original.morphAttributes, targets);
    mesh.geometry = this.geometry;
    this.#enclose();
  }

  /** Fit the sphere around both ends: whatever lies between them is inside, and nothing is culled away. */
  #enclose() {
    const { after } = this;
    const both = new BufferGeometry();
    const joined = new Float32Array(this.before.length + after.length);
    joined.set(this.before);
    after.forEach((value, i) => (joined[this.before.length + i] = this.before[i] + MOST * (value - this.before[i])));
    both.setAttribute("position", new BufferAttribute(joined, 3));
    both.computeBoundingSphere();
    both.computeBoundingBox();
    this.geometry.boundingSphere = both.boundingSphere;
    this.geometry.boundingBox = both.boundingBox;
  }

  /** What it leads to, to lead there again. */
  get end() {
    return [this.after, ...this.tracks.map(({ after }) => after)];
  }

  set end([after, ...tracks]) {
    this.after = after;
    this.tracks.forEach((track, i) => (track.after = tracks[i]));
    this.#enclose();
  }

  /** @param {Float32Array} positions (3V) in the order of the result @returns {Float32Array} in that of the mesh */
  ordered(positions) {
    const { order } = this;
    return order ? Float32Array.from({ length: 3 * order.length }, (_, i) => positions[3 * order[Math.floor(i / 3)] + (i % 3)]) : positions;
  }

  /** Lead to another shape. @param {Float32Array} after (3V) in the mesh's own space */
  reshape(after) {
    this.after = after;
    for (const track of this.tracks) {
      if (track.name === "position") track.after = this.after;
      if (track.name === "normal") track.after = normalsOf(this.after, this.original.index);
    }
    this.#enclose();
  }

  /** @param {string} name @param {number} size @param {Float32Array} before @param {Float32Array} after */
  #track(name, size, before, after) {
    const attribute = new BufferAttribute(before.slice(), size).setUsage(DynamicDrawUsage);
    this.geometry.setAttribute(name, attribute);
    this.tracks.push({ name, attribute, before, after });
  }

  /** @param {number} t */
  set(t) {
    for (const { attribute, before, after } of this.tracks) {
      // The ends are the files' own numbers, without rounding.
      if (t === 0 || t === 1) attribute.array.set(t ? after : before);
      else for (let i = 0; i < before.length; i++) attribute.array[i] = before[i] + t * (after[i] - before[i]);
      attribute.needsUpdate = true;
    }
  }

  dispose() {
    this.mesh.geometry = this.original;
    this.geometry.dispose();
  }
}

/** All meshes of an asset between source (0) and result (1). */
export class Deformation {
  /** @param {Pair[]} pairs @param {import("./puppet.js").Puppet} puppet */
  constructor(pairs, puppet) {
    this.puppet = puppet;
    this.blends = pairs.map((pair) => new Blend(pair));
    this.morph = 0;
  }

  /** @param {number} t */
  setMorph(t) {
    this.morph = Math.min(Math.max(t, 0), MOST);
    this.show(this.morph);
  }

  /** Lead to another shape of the same asset, whose normals are those of its faces. @param {Map<string, Float32Array>} positions by the primitives of the result */
  reshape(positions) {
    for (const blend of this.blends) {
      const own = positions.get(blend.primitive);
      if (own?.length === 3 * blend.count) blend.reshape(blend.ordered(own));
    }
    this.show(this.morph);
  }

  /** How far the vertices of each mesh move towards a shape, for `mix`. @param {Map<string, Float32Array> | null} positions as for `reshape`; null: what it leads to @returns {Float32Array[]} */
  offsets(positions) {
    return this.blends.map((blend) => {
      const own = positions?.get(blend.primitive);
      const after = own ? blend.ordered(own) : blend.after;
      return after.map((value, i) => value - blend.before[i]);
    });
  }

  /** Lead to shares of several shapes together. @param {[Float32Array[], number][]} shapes offsets, and how much of them */
  mix(shapes) {
    this.blends.forEach((blend, k) => {
      const after = Float32Array.from(blend.before);
      for (const [offsets, share] of shapes) for (let i = 0; i < after.length; i++) after[i] += share * offsets[k][i];
      blend.reshape(after);
    });
    this.show(this.morph);
  }

  /** Do something while another shape is shown. @template T @param {Map<string, Float32Array>} positions As for `reshape`. @param {() => T} act @returns {T} */
  peek(positions, act) {
    const { morph } = this;
    const kept = this.blends.map((blend) => blend.end);
    this.morph = 1;
    try {
      this.reshape(positions);
      return act();
    } finally {
      this.blends.forEach((blend, i) => (blend.end = kept[i]));
      this.morph = morph;
      this.show(morph);
    }
  }

  /** Look at another share of the way, for a moment. @param {number} t */
  show(t) {
    for (const blend of this.blends) blend.set(t);
    this.puppet.share = t;
  }

  dispose() {
    for (const blend of this.blends) blend.dispose();
    this.puppet.meet(null);
  }
}

/**
 * The morph targets of both ends, which `Puppet` weighs by how far it is on the way.
 * @param {BufferGeometry["morphAttributes"]} before
 * @param {BufferGeometry["morphAttributes"]} after
 */
function bothTargets(before, after) {
  const names = /** @type {(keyof typeof before)[]} */ (Object.keys(before));
  const same = (/** @type {any[]} */ a, /** @type {any[]} */ b) => a.every(({ array }, k) => array.every((/** @type {number} */ value, /** @type {number} */ i) => value === b[k].array[i]));
  if (names.some((name) => after[name]?.length !== before[name]?.length) || names.every((name) => same(before[name] ?? [], after[name] ?? []))) return before;
  return Object.fromEntries(names.map((name) => [name, [...(before[name] ?? []), ...(after[name] ?? [])]]));
}

/** A geometry with the same attributes, not copies of them; its own can be replaced. @param {BufferGeometry} geometry */
function shareGeometry(geometry) {
  const own = new BufferGeometry();
  own.name = geometry.name;
  own.setIndex(geometry.index);
  for (const [name, attribute] of Object.entries(geometry.attributes)) own.setAttribute(name, attribute);
  own.morphAttributes = geometry.morphAttributes;
  own.morphTargetsRelative = geometry.morphTargetsRelative;
  for (const { start, count, materialIndex } of geometry.groups) own.addGroup(start, count, materialIndex);
  own.setDrawRange(geometry.drawRange.start, geometry.drawRange.count);
  return own;
}

/** Normals of positions whose file has none. @param {Float32Array} positions @param {BufferAttribute | null} index @returns {Float32Array} */
function normalsOf(positions, index) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setIndex(index);
  geometry.computeVertexNormals();
  return /** @type {Float32Array} */ (geometry.attributes.normal.array);
}

/**
 * Where the vertices of a mesh are seen in the world: under its node, or where its bones carry them, with its morph targets.
 * @template {Float32Array | Float64Array} T
 * @param {import("three").Mesh} mesh below a root whose world matrices are up to date
 * @param {T} out
 * @param {number} [first] number in it
 * @param {import("three").Matrix4} [world] from the mesh to the world
 * @returns {T}
 */
export function worldPositions(mesh, out, first = 0, world = mesh.matrixWorld) {
  const point = new Vector3();
  const { count } = mesh.geometry.attributes.position;
  for (let v = 0; v < count; v++) mesh.getVertexPosition(v, point).applyMatrix4(world).toArray(out, first + 3 * v);
  return out;
}
