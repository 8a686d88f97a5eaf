// @ts-check
/** An arrow on the ground that points out of the side taken as the front, and can be turned with the pointer. */
import {
  Box3,
  DoubleSide,
  Mesh,
  MeshBasicMaterial,
  Plane,
  Shape,
  ShapeGeometry,
  Vector3,
} from "../vendor/three/three.module.js";
import { follow } from "./surface.js";

const INNER = 1.06; // times half the longer side of the ground, from the middle of the asset
const OUTER = 1.55;
const ROOM = 1.12; // a square of this half side, whose corners are about as far away as the tip
const GRIP = 25; // degrees on either side at which the pointer takes hold
const STEP = 5;
const COLOUR = 0xd9622b;

export class FrontArrow {
  /**
   * @param {import("./stage.js").Stage} stage
   * @param {import("./cameras.js").CameraRig} rig
   * @param {import("./surface.js").Surface} surface
   * @param {(degrees: number, done: boolean) => void} turned by the pointer; 0 is +Z, 90 is +X
   */
  constructor(stage, rig, surface, turned) {
    this.rig = rig;
    this.surface = surface;
    this.canvas = surface.canvas;
    this.turned = turned;
    this.center = new Vector3();
    this.radius = 1;
    this.degrees = 0;
    this.mesh = new Mesh(outline(), new MeshBasicMaterial({ color: COLOUR, side: DoubleSide, transparent: true, depthWrite: false, toneMapped: false }));
    this.mesh.userData.overlay = true; // it throws no shadow
    this.mesh.renderOrder = -1;
    this.mesh.visible = false;
    stage.scene.add(this.mesh);
    this.stop = new AbortController();
    const options = { signal: this.stop.signal, capture: true };
    // Before the camera's own listeners: what takes the arrow does not turn the camera.
    this.canvas.addEventListener("pointerdown", (event) => this.#take(event), options);
    this.canvas.addEventListener("pointermove", (event) => this.#hover(event), options);
  }

  /** @param {number} degrees @param {boolean} faint whether it is only a guess */
  show(degrees, faint) {
    this.degrees = degrees;
    this.mesh.material.opacity = faint ? 0.35 : 0.9;
    this.mesh.visible = true;
    this.#place();
  }

  hide() {
    this.mesh.visible = false;
  }

  /** Put it around a box. @param {Box3} box is grown so that the arrow is seen */
  enclose(box) {
    const size = box.getSize(new Vector3());
    box.getCenter(this.center);
    this.center.y = box.min.y;
    this.radius = Math.max(size.x / 2, size.z / 2, size.y / 4, 1e-9);
    this.#place();
    if (!this.mesh.visible) return;
    const reach = new Vector3(ROOM * this.radius, 0, ROOM * this.radius);
    box.expandByPoint(this.center.clone().add(reach)).expandByPoint(this.center.clone().sub(reach));
  }

  #place() {
    this.mesh.position.copy(this.center);
    this.mesh.position.y += 0.002 * this.radius;
    this.mesh.rotation.y = (this.degrees * Math.PI) / 180;
    this.mesh.scale.setScalar(this.radius);
  }

  /** @param {PointerEvent} event @returns {Vector3 | null} from the middle, where the pointer is on the ground */
  #onGround(event) {
    const found = this.surface.cast(event, this.rig.camera).ray.intersectPlane(new Plane(new Vector3(0, 1, 0), -this.center.y), new Vector3());
    return found ? found.sub(this.center) : null;
  }

  /** @param {PointerEvent} event @returns {boolean} whether the pointer is on the arrow */
  #on(event) {
    const place = this.mesh.visible ? this.#onGround(event) : null;
    if (!place) return false;
    const distance = place.length() / this.radius;
    const apart = Math.abs(((azimuth(place) - this.degrees + 540) % 360) - 180);
    return apart < GRIP && distance > 0.9 * INNER && distance < 1.1 * OUTER;
  }

  /** @param {PointerEvent} event */
  #hover(event) {
    this.canvas.style.cursor = this.#on(event) ? "grab" : "";
  }

  /** @param {PointerEvent} event */
  #take(event) {
    if (event.button !== 0 || !this.#on(event)) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    const turn = (/** @type {PointerEvent} */ moved, /** @type {boolean} */ done) => {
      const place = this.#onGround(moved);
      if (place) this.turned((Math.round(azimuth(place) / STEP) * STEP) % 360, done);
    };
    const end = (/** @type {PointerEvent} */ ended) => turn(ended, true);
    follow(event, this.stop.signal, { move: (moved) => turn(moved, false), end, cancel: end });
  }

  dispose() {
    this.stop.abort();
    this.mesh.removeFromParent();
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}

/** @param {Vector3} place @returns {number} degrees from +Z towards +X, 0 to 360 */
function azimuth(place) {
  return ((Math.atan2(place.x, place.z) * 180) / Math.PI + 360) % 360;
}

/** An arrow of unit radius that lies on the ground and points along +Z. */
function outline() {
  const head = 0.28;
  const shape = new Shape();
  const corners = [[-0.07, INNER], [0.07, INNER], [0.07, OUTER - head], [0.2, OUTER - head], [0, OUTER], [-0.2, OUTER - head], [-0.07, OUTER - head]];
  corners.forEach(([x, y], index) => (index ? shape.lineTo(x, y) : shape.moveTo(x, y)));
  // From the plane of a shape to the ground: its y becomes +Z.
  return new ShapeGeometry(shape).rotateX(Math.PI / 2);
}
