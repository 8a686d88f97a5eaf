// @ts-check
/** What lies over an asset while its regions and handles are edited: kept faces, a box, handles, the brush. */
import {
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  Group,
  LineBasicMaterial,
  LineLoop,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  SphereGeometry,
  Vector3,
} from "../../vendor/three/three.module.js";

const KEPT = 0x2b6fb3;
const PULLED = 0x8a4fd0;
const TOOL = 0xd9622b;
const POINT = 0.011; // of the diagonal
const CIRCLE = 48;

/** @typedef {[number, number, number]} Place */
/** @typedef {{ min: Place, max: Place }} Box */
/** @typedef {{ position: Place | null, to: Place }} Marks `position` is null where only the service knows the point */

export class Overlay {
  /** @param {import("three").Scene} scene */
  constructor(scene) {
    this.group = new Group();
    scene.add(this.group);
    this.kept = this.#own(tint(KEPT, 0.55));
    this.pulled = this.#own(tint(PULLED, 0.5));
    this.part = this.#own(tint(TOOL, 0.5));
    this.box = this.#own(new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: TOOL, toneMapped: false })));
    this.brush = this.#own(new LineLoop(circle(), new LineBasicMaterial({ color: TOOL, toneMapped: false, depthTest: false })));
    this.lines = this.#own(new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: TOOL, toneMapped: false, depthTest: false })));
    this.ball = new SphereGeometry(1, 16, 12);
    this.solid = new MeshBasicMaterial({ color: TOOL, toneMapped: false, depthTest: false, transparent: true });
    this.pale = new MeshBasicMaterial({ color: KEPT, toneMapped: false, depthTest: false, transparent: true });
    /** @type {Mesh[]} */
    this.balls = [];
    this.diagonal = 1;
    this.tints = [this.kept, this.pulled, this.part];
    for (const one of [...this.tints, this.box, this.brush, this.lines]) one.visible = false;
  }

  /**
   * @template {import("three").Object3D} T
   * @param {T} object
   * @returns {T} that throws no shadow and is no part of the asset
   */
  #own(object) {
    object.userData.overlay = true;
    object.renderOrder = 2;
    this.group.add(object);
    return object;
  }

  /** @param {import("./surface.js").NumberedSurface | null} surface */
  setSurface(surface) {
    for (const mesh of this.tints) {
      mesh.geometry.dispose();
      mesh.geometry = new BufferGeometry();
      mesh.visible = false;
      if (surface) mesh.geometry.setAttribute("position", new BufferAttribute(surface.shown, 3));
    }
    if (!surface) return;
    this.kept.geometry.computeBoundingBox();
    this.diagonal = this.kept.geometry.boundingBox?.getSize(new Vector3()).length() || 1;
  }

  /** The vertices of the surface have moved. */
  follow() {
    for (const { geometry } of this.tints) if (geometry.attributes.position) geometry.attributes.position.needsUpdate = true;
  }

  /** @param {Uint8Array} flags (F) faces that do not move @param {Uint32Array} corners (3F) */
  setKept(flags, corners) {
    this.#show(this.kept, flags, corners);
  }

  /** @param {Uint8Array} flags (F) faces that a prompt with a region pulls at @param {Uint32Array} corners (3F) */
  setPulled(flags, corners) {
    this.#show(this.pulled, flags, corners);
  }

  /** @param {Uint8Array} flags (F) faces of a part that is pointed at @param {Uint32Array} corners (3F) */
  setPart(flags, corners) {
    this.#show(this.part, flags, corners);
  }

  /** @param {Mesh} mesh @param {Uint8Array} flags (F) @param {Uint32Array} corners (3F) */
  #show(mesh, flags, corners) {
    const count = flags.reduce((sum, flag) => sum + flag, 0);
    const index = new Uint32Array(3 * count);
    let at = 0;
    flags.forEach((flag, f) => {
      if (!flag) return;
      index.set(corners.subarray(3 * f, 3 * f + 3), at);
      at += 3;
    });
    mesh.geometry.setIndex(new BufferAttribute(index, 1));
    mesh.visible = count > 0;
  }

  /** @param {Box | null} box @param {Marks[]} handles @param {number} chosen */
  setMarks(box, handles, chosen) {
    this.box.visible = box !== null;
    /** @type {[Place, boolean][]} */
    const points = box ? sides(box).map((place) => [place, true]) : [];
    replace(this.box, box ? edges(box) : []);
    const lines = handles.flatMap(({ position, to }) => (position ? [...position, ...to] : []));
    replace(this.lines, lines);
    this.lines.visible = lines.length > 0;
    handles.forEach(({ position, to }, i) => points.push(...(position ? [/** @type {[Place, boolean]} */ ([position, false])] : []), [to, i === chosen || chosen < 0]));
    for (const ball of this.balls.splice(points.length)) ball.removeFromParent();
    while (this.balls.length < points.length) this.balls.push(this.#own(new Mesh(this.ball, this.solid)));
    points.forEach(([place, solid], i) => {
      this.balls[i].position.fromArray(place);
      this.balls[i].scale.setScalar(POINT * this.diagonal);
      this.balls[i].material = solid ? this.solid : this.pale;
      this.balls[i].renderOrder = solid ? 4 : 3;
    });
  }

  /** @param {Vector3 | null} point @param {Vector3} [normal] @param {number} [radius] */
  setBrush(point, normal, radius = 1) {
    this.brush.visible = point !== null;
    if (!point || !normal) return;
    this.brush.position.copy(point).addScaledVector(normal, 0.002 * this.diagonal);
    this.brush.quaternion.setFromUnitVectors(new Vector3(0, 0, 1), normal);
    this.brush.scale.setScalar(radius);
  }

  dispose() {
    this.group.removeFromParent();
    for (const { geometry, material } of [this.kept, this.pulled, this.box, this.brush, this.lines]) {
      geometry.dispose();
      material.dispose();
    }
    for (const one of [this.ball, this.solid, this.pale]) one.dispose();
  }
}

/** A colour over some of the faces. @param {number} color @param {number} opacity */
function tint(color, opacity) {
  const mesh = new Mesh(new BufferGeometry(), new MeshBasicMaterial({ color, transparent: true, opacity, side: DoubleSide, depthWrite: false, toneMapped: false }));
  mesh.frustumCulled = false;
  return mesh;
}

/** @param {Box} box @returns {Place[]} the middle of each side: x down, x up, y down ... */
export function sides({ min, max }) {
  const middle = /** @type {Place} */ ([0, 1, 2].map((axis) => (min[axis] + max[axis]) / 2));
  return [0, 1, 2].flatMap((axis) => [min, max].map((end) => /** @type {Place} */ (middle.map((value, i) => (i === axis ? end[axis] : value)))));
}

/** @param {Box} box @returns {number[]} the ends of its twelve edges */
function edges({ min, max }) {
  const corner = (/** @type {number} */ bits) => [0, 1, 2].map((axis) => (bits & (1 << axis) ? max : min)[axis]);
  const found = [];
  for (let bits = 0; bits < 8; bits++) for (const bit of [1, 2, 4]) if (!(bits & bit)) found.push(...corner(bits), ...corner(bits | bit));
  return found;
}

/** @param {LineSegments} lines @param {number[]} positions */
function replace(lines, positions) {
  lines.geometry.dispose();
  lines.geometry = new BufferGeometry();
  lines.geometry.setAttribute("position", new BufferAttribute(Float32Array.from(positions), 3));
  lines.frustumCulled = false;
}

function circle() {
  const places = Array.from({ length: CIRCLE }, (_, i) => [Math.cos((2 * Math.PI * i) / CIRCLE), Math.sin((2 * Math.PI * i) / CIRCLE), 0]);
  return new BufferGeometry().setAttribute("position", new BufferAttribute(Float32Array.from(places.flat()), 3));
}
