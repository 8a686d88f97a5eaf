// @ts-check
/** What lies over an asset: faces that are kept, painted or pointed at, and the brush. */
import { BufferAttribute, BufferGeometry, DoubleSide, Group, LineBasicMaterial, LineLoop, Mesh, MeshBasicMaterial, Vector3 } from "../../vendor/three/three.module.js";

const KEPT = 0x2b6fb3;
const PULLED = 0x8a4fd0;
const TOOL = 0xd9622b;
const CIRCLE = 48;

export class Overlay {
  /** @param {import("three").Scene} scene */
  constructor(scene) {
    this.group = new Group();
    scene.add(this.group);
    this.kept = this.#own(tint(KEPT, 0.55));
    this.pulled = this.#own(tint(PULLED, 0.5));
    this.part = this.#own(tint(TOOL, 0.5));
    this.brush = this.#own(new LineLoop(circle(), new LineBasicMaterial({ color: TOOL, toneMapped: false, depthTest: false })));
    this.diagonal = 1;
    this.tints = [this.kept, this.pulled, this.part];
    for (const one of [...this.tints, this.brush]) one.visible = false;
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
    for (const { geometry, material } of [...this.tints, this.brush]) {
      geometry.dispose();
      material.dispose();
    }
  }
}

/** A colour over some of the faces. @param {number} color @param {number} opacity */
function tint(color, opacity) {
  const mesh = new Mesh(new BufferGeometry(), new MeshBasicMaterial({ color, transparent: true, opacity, side: DoubleSide, depthWrite: false, toneMapped: false }));
  mesh.frustumCulled = false;
  return mesh;
}

function circle() {
  const points = Array.from({ length: CIRCLE }, (_, i) => [Math.cos((2 * Math.PI * i) / CIRCLE), Math.sin((2 * Math.PI * i) / CIRCLE), 0]);
  return new BufferGeometry().setAttribute("position", new BufferAttribute(Float32Array.from(points.flat()), 3));
}
