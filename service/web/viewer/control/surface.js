// @ts-check
/**
 * The surface of an asset as one list of triangles, numbered as the service numbers them: the mesh instances of the
 * scene depth first, of each its primitives, those that share their vertices together.
 */
import { Matrix4, Vector3 } from "../../vendor/three/three.module.js";
import { worldPositions } from "../deformation.js";
import { isHidden, meshesOf, originOf, triangleCount } from "../loading.js";
import { floats } from "../topology.js";
import { weld } from "../weld.js";
import { readObjFaces } from "./obj-faces.js";

const FLAT = 1e-9;

export class NumberedSurface {
  /**
   * @param {Float32Array} shown (3V) where the vertices are seen, in the world
   * @param {Float32Array} rest (3V) where the service has them: a skin in its rest pose
   * @param {Uint32Array} corners (3F)
   * @param {import("three").Mesh[]} meshes that may move, in the order of their vertices
   */
  constructor(shown, rest, corners, meshes = []) {
    this.shown = shown;
    this.rest = rest;
    this.corners = corners;
    this.meshes = meshes;
    /** @type {Uint32Array | null} */
    this.welded = null;
  }

  /** @returns {number} of triangles */
  get count() {
    return this.corners.length / 3;
  }

  /** @returns {Uint32Array} (V) the first vertex where each lies */
  get groups() {
    this.welded ??= weld(this.rest);
    return this.welded;
  }

  /** Take the vertices for where they are seen now. @param {import("three").Object3D} root */
  follow(root) {
    root.updateMatrixWorld(true);
    let first = 0;
    for (const mesh of this.meshes) {
      worldPositions(mesh, this.shown, first, /** @type {any} */ (mesh).isSkinnedMesh ? mesh.matrixWorld : placement(mesh));
      first += 3 * mesh.geometry.attributes.position.count;
    }
  }
}

/**
 * Number the faces of what is loaded.
 * @param {import("three").Object3D} root
 * @param {(string | number)[]} excluded nodes that the service leaves as they are, by name or index
 * @returns {NumberedSurface | null} null where the numbers cannot be known
 */
export function numberedSurface(root, excluded = []) {
  const origin = originOf(root);
  if (!origin) return null;
  root.updateWorldMatrix(true, true);
  if (origin.json && origin.nodes) return ofGltf(root, origin.json, origin.nodes, excluded);
  if (excluded.length) return null;
  if (origin.format === "obj" && origin.buffer) {
    const found = readObjFaces(new TextDecoder().decode(origin.buffer));
    return found && ofFaces(Float32Array.from(found.positions), found.corners);
  }
  const [mesh, ...more] = meshesOf(root);
  if (more.length || (origin.format === "ply" && !onlyTriangles(origin.buffer, triangleCount(mesh)))) return null;
  return ofFaces(floats(mesh.geometry.attributes.position, 3, null), cornersOf(mesh, 4));
}

/** @param {Float32Array} positions @param {Uint32Array} corners */
function ofFaces(positions, corners) {
  return new NumberedSurface(positions, positions, corners);
}

/** The loader divides quads along the other diagonal. @param {ArrayBuffer | undefined} buffer @param {number} triangles */
function onlyTriangles(buffer, triangles) {
  const head = new TextDecoder("latin1").decode(new Uint8Array(buffer ?? new ArrayBuffer(0)).subarray(0, 1 << 16));
  return Number(/^element\s+face\s+(\d+)/m.exec(head)?.[1]) === triangles;
}

/** @param {import("three").Object3D} root @param {Record<string, any>} json @param {Map<object, number>} nodes @param {(string | number)[]} excluded */
function ofGltf(root, json, nodes, excluded) {
  /** @type {Map<number, import("three").Mesh[]>} */
  const meshes = new Map();
  for (const mesh of meshesOf(root)) {
    /** @type {import("three").Object3D | null} */
    let at = mesh;
    while (at && !nodes.has(at)) at = at.parent;
    const node = at ? Number(nodes.get(at)) : -1;
    meshes.set(node, [...(meshes.get(node) ?? []), mesh]);
  }
  const all = json.nodes ?? [];
  const named = all.flatMap((/** @type {any} */ node, /** @type {number} */ at) => (excluded.includes(at) || excluded.includes(nameOf(json, node)) ? [at] : []));
  const without = new Set(withChildren(all, named));
  const made = new Joined();
  for (const node of depthFirst(json)) {
    const { mesh } = all[node];
    if (mesh === undefined || without.has(node)) continue;
    const primitives = (json.meshes[mesh].primitives ?? []).filter((/** @type {any} */ found) => (found.mode ?? 4) >= 4 && found.attributes?.POSITION !== undefined);
    const drawn = meshes.get(node) ?? [];
    if (drawn.length !== primitives.length) return null;
    if (drawn.length && isFlat(placement(drawn[0]))) continue;
    for (const at of together(primitives)) made.add(drawn[at], primitives[at].mode ?? 4);
  }
  const surface = new NumberedSurface(new Float32Array(3 * made.vertices), Float32Array.from(made.positions.flat()), Uint32Array.from(made.corners.flat()), made.meshes);
  surface.follow(root);
  return surface;
}

/** What several meshes come to. */
class Joined {
  constructor() {
    /** @type {number[][]} */
    this.positions = [];
    /** @type {number[][]} */
    this.corners = [];
    /** @type {import("three").Mesh[]} */
    this.meshes = [];
    this.vertices = 0;
  }

  /** @param {import("three").Mesh} mesh @param {number} mode */
  add(mesh, mode) {
    const positions = restPositions(mesh);
    const at = placement(mesh);
    const point = new Vector3();
    const moved = Array.from(positions);
    for (let i = 0; i < moved.length; i += 3) point.fromArray(positions, i).applyMatrix4(at).toArray(moved, i);
    this.meshes.push(mesh);
    this.positions.push(moved);
    this.corners.push(Array.from(cornersOf(mesh, mode), (corner) => corner + this.vertices));
    this.vertices += positions.length / 3;
  }
}

/** @param {import("three").Mesh} mesh @returns {Float32Array} with what its morph targets add at rest */
function restPositions({ geometry, morphTargetInfluences }) {
  const positions = floats(geometry.attributes.position, 3, null).slice();
  (geometry.morphAttributes.position ?? []).forEach((target, k) => {
    const weight = morphTargetInfluences?.[k] ?? 0;
    if (weight) floats(target, 3, null).forEach((value, i) => (positions[i] += weight * value));
  });
  return positions;
}

/** @param {import("three").Mesh} mesh @param {number} mode of the file: 4 a list, 5 a strip, 6 a fan @returns {Uint32Array} */
function cornersOf({ geometry }, mode) {
  const count = 3 * Math.floor((geometry.index ? geometry.index.count : geometry.attributes.position.count) / 3);
  const corners = Uint32Array.from({ length: count }, (_, i) => (geometry.index ? geometry.index.getX(i) : i));
  if (mode === 4) return corners;
  // What only joins the pieces of a strip is no triangle.
  const kept = [];
  for (let i = 0; i < count; i += 3) {
    const [a, b, c] = corners.subarray(i, i + 3);
    if (a !== b && b !== c && c !== a) kept.push(a, b, c);
  }
  return Uint32Array.from(kept);
}

/** @param {import("three").Mesh} mesh @returns {Matrix4} from its own space to the world of the service */
function placement(mesh) {
  const { isInstancedMesh, isSkinnedMesh, skeleton } = /** @type {any} */ (mesh);
  if (isInstancedMesh) {
    const first = new Matrix4();
    /** @type {import("three").InstancedMesh} */ (mesh).getMatrixAt(0, first);
    return first.premultiply(mesh.matrixWorld);
  }
  if (!isSkinnedMesh) return mesh.matrixWorld;
  // That of the joint which agrees best with all others.
  const all = /** @type {Matrix4[]} */ (skeleton.bones.map((/** @type {any} */ bone, /** @type {number} */ i) => new Matrix4().multiplyMatrices(bone.matrixWorld, skeleton.boneInverses[i])));
  const mean = all[0].elements.map((_, i) => all.reduce((sum, { elements }) => sum + elements[i], 0) / all.length);
  const far = (/** @type {Matrix4} */ { elements }) => elements.reduce((sum, value, i) => sum + Math.abs(value - mean[i]), 0);
  return all.reduce((best, matrix) => (far(matrix) < far(best) ? matrix : best));
}

/** @param {Matrix4} matrix */
function isFlat(matrix) {
  const scale = matrix.getMaxScaleOnAxis();
  return !(Math.abs(matrix.determinant()) > FLAT * scale ** 3);
}

/** @param {any[]} primitives @returns {number[]} their numbers: those that share their vertices one after the other */
function together(primitives) {
  /** @type {Map<string, number[]>} */
  const found = new Map();
  primitives.forEach(({ attributes }, at) => {
    const key = [attributes.POSITION, attributes.NORMAL, attributes.TANGENT].join();
    found.set(key, [...(found.get(key) ?? []), at]);
  });
  return [...found.values()].flat();
}

/** @param {Record<string, any>} json @returns {number[]} nodes of the default scene */
function depthFirst(json) {
  const visit = (/** @type {number} */ node) => /** @type {number[]} */ (isHidden(json.nodes[node]) ? [] : [node, ...(json.nodes[node].children ?? []).flatMap(visit)]);
  return (json.scenes?.[json.scene ?? 0]?.nodes ?? []).flatMap(visit);
}

/** @param {Record<string, any>[]} nodes @param {number[]} begin */
function withChildren(nodes, begin) {
  const found = [...begin];
  for (const at of found) found.push(...(nodes[at]?.children ?? []));
  return found;
}

/** A node without a name has that of its mesh. @param {Record<string, any>} json @param {Record<string, any>} node */
function nameOf(json, node) {
  return String(node?.name || json.meshes?.[node?.mesh]?.name || "").slice(0, 200);
}
