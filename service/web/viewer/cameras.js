// @ts-check
/** A viewer's camera: framing, steering, and moving together with others. */
import { Box3, MathUtils, PerspectiveCamera, Vector3 } from "../vendor/three/three.module.js";
import { OrbitControls } from "../vendor/three/addons/controls/OrbitControls.js";

const AZIMUTH = 32; // degrees; 0 looks at the front (+Z), 90 at the left side (+X)
const ELEVATION = 14;
const FOV = 32;
const MARGIN = 1.04; // 1 touches the picture's border

/** @typedef {{ position: [number, number, number], target: [number, number, number] }} CameraState */

/**
 * Put a camera where a box fills the picture.
 * @param {PerspectiveCamera} camera its aspect is set
 * @param {Box3} box
 * @param {Vector3} direction unit vector from the target to the camera
 * @returns {Vector3} the target
 */
export function frameBox(camera, box, direction) {
  const center = box.getCenter(new Vector3());
  const half = box.getSize(new Vector3()).multiplyScalar(0.5);
  camera.position.copy(center).add(direction);
  camera.lookAt(center);
  const turned = camera.quaternion.clone().invert();
  const tan = Math.tan(MathUtils.degToRad(camera.fov) / 2) / MARGIN;
  let distance = 1e-9;
  for (let corner = 0; corner < 8; corner++) {
    const { x, y, z } = new Vector3(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1).multiply(half).applyQuaternion(turned);
    distance = Math.max(distance, Math.abs(x) / (tan * camera.aspect) + z, Math.abs(y) / tan + z);
  }
  camera.position.copy(direction).multiplyScalar(distance).add(center);
  setDepthRange(camera, box);
  return center;
}

/** @param {PerspectiveCamera} camera @param {Box3} box */
function setDepthRange(camera, box) {
  const radius = Math.max(box.getSize(new Vector3()).length() / 2, 1e-9);
  const distance = camera.position.distanceTo(box.getCenter(new Vector3()));
  camera.near = Math.max(distance - 2 * radius, radius / 200);
  camera.far = distance + 8 * radius;
  camera.updateProjectionMatrix();
}

/** @returns {PerspectiveCamera} */
export function makeCamera() {
  return new PerspectiveCamera(FOV, 1, 0.1, 100);
}

/** @returns {Vector3} where the camera stands at first, from its target */
export function defaultDirection() {
  return new Vector3().setFromSphericalCoords(1, MathUtils.degToRad(90 - ELEVATION), MathUtils.degToRad(AZIMUTH));
}

/** Steers a camera around a box: pointer, touch and the commands of the keyboard. */
export class CameraRig {
  /** @param {HTMLElement} surface takes the pointer @param {() => void} changed the picture is old */
  constructor(surface, changed) {
    this.surface = surface;
    this.camera = makeCamera();
    this.box = new Box3(new Vector3(-1, -1, -1), new Vector3(1, 1, 1));
    /** From where a reset looks: a unit vector from the target. */
    this.home = defaultDirection();
    /** Whether someone steered since the last reset. */
    this.touched = false;
    this.orbit = new OrbitControls(this.camera, surface);
    this.orbit.enableDamping = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.orbit.dampingFactor = 0.12;
    this.orbit.rotateSpeed = 0.9;
    this.orbit.addEventListener("start", () => (this.touched = true));
    this.orbit.addEventListener("change", changed);
    surface.style.touchAction = "pan-y"; // a finger that goes up or down scrolls the page
    this.changed = changed;
  }

  /** @param {Box3} box what is framed and bounds the zoom */
  setBox(box) {
    this.box.copy(box);
    const radius = box.getSize(new Vector3()).length() / 2;
    this.orbit.minDistance = radius * 0.05;
    this.orbit.maxDistance = radius * 30;
  }

  reset() {
    this.touched = false;
    this.#stop();
    const target = frameBox(this.camera, this.box, this.home);
    this.#settle(target);
  }

  /** @param {number} aspect width / height */
  setAspect(aspect) {
    this.camera.aspect = aspect;
    this.camera.updateProjectionMatrix();
    if (!this.touched) this.reset();
  }

  /** Let what still swings come to rest, before the camera is put anywhere: `orbit` would add it to that. */
  #stop() {
    const damping = this.orbit.enableDamping;
    this.orbit.enableDamping = false;
    this.orbit.update();
    this.orbit.enableDamping = damping;
  }

  /** @param {Vector3} target */
  #settle(target) {
    this.orbit.target.copy(target);
    this.#stop();
    this.changed();
  }

  /** @returns {boolean} whether the camera still swings */
  update() {
    const moving = this.orbit.update();
    setDepthRange(this.camera, this.box);
    return moving;
  }

  /** @returns {CameraState} */
  get state() {
    return { position: this.camera.position.toArray(), target: this.orbit.target.toArray() };
  }

  set state({ position, target }) {
    this.touched = true;
    this.#stop();
    this.camera.position.fromArray(position);
    this.#settle(new Vector3().fromArray(target));
  }

  /** @returns {{ azimuth: number, elevation: number }} from where it looks, in degrees */
  get side() {
    return { azimuth: MathUtils.radToDeg(this.orbit.getAzimuthalAngle()), elevation: 90 - MathUtils.radToDeg(this.orbit.getPolarAngle()) };
  }

  set side({ azimuth, elevation }) {
    const { target } = this.orbit;
    const angle = MathUtils.degToRad(90 - MathUtils.clamp(elevation, -89, 89));
    const arm = new Vector3().setFromSphericalCoords(this.orbit.getDistance(), angle, MathUtils.degToRad(azimuth));
    this.state = { position: arm.add(target).toArray(), target: target.toArray() };
  }

  /** @param {number} azimuth @param {number} elevation radians */
  rotate(azimuth, elevation) {
    this.#step(() => {
      this.orbit.rotateLeft(azimuth);
      this.orbit.rotateUp(-elevation);
    });
  }

  /** @param {number} factor */
  zoom(factor) {
    this.#step(() => this.orbit.dollyIn(factor));
  }

  /** @param {number} x @param {number} y share of the picture's height */
  pan(x, y) {
    const { clientHeight } = this.surface;
    this.#step(() => this.orbit.pan(x * clientHeight, -y * clientHeight));
  }

  /** Steer without swinging on. @param {() => void} act */
  #step(act) {
    this.touched = true;
    this.#stop();
    const damping = this.orbit.enableDamping;
    this.orbit.enableDamping = false;
    act();
    this.orbit.enableDamping = damping;
    this.changed();
  }

  dispose() {
    this.orbit.dispose();
  }
}

/** @typedef {EventTarget & { rig: CameraRig, ready: boolean, ownBox: Box3 }} Linkable */

/** Let viewers move together. All frame the box around all of them, so that sizes can be compared. @param {...Linkable} viewers */
export function linkCameras(...viewers) {
  let busy = false;
  const follow = (/** @type {Event} */ event) => {
    if (busy) return;
    const leader = /** @type {Linkable} */ (event.currentTarget);
    if (!leader.ready || !leader.rig.touched) return;
    busy = true;
    const state = leader.rig.state;
    for (const viewer of viewers) if (viewer !== leader && viewer.ready) viewer.rig.state = state;
    busy = false;
  };
  const reset = () => {
    if (busy) return;
    busy = true;
    const box = new Box3();
    for (const viewer of viewers) if (viewer.ready) box.union(viewer.ownBox);
    for (const viewer of viewers) {
      if (!viewer.ready) continue;
      viewer.rig.setBox(box);
      viewer.rig.reset();
    }
    busy = false;
  };
  const settle = () => {
    const leader = viewers.find((viewer) => viewer.ready && viewer.rig.touched);
    if (!leader) return reset();
    follow(/** @type {any} */ ({ currentTarget: leader }));
  };
  for (const viewer of viewers) {
    viewer.addEventListener("camerachange", follow);
    viewer.addEventListener("camerareset", reset);
    viewer.addEventListener("ready", settle);
  }
  if (viewers.some((viewer) => viewer.ready)) settle();
}
