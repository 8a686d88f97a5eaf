// @ts-check
/**
 * Point at an asset: paint its faces, drag the sides of a box, pick a part, take a point somewhere else. What a tool
 * takes hold of does not turn the camera; beside it, the pointer turns it as ever. Two fingers turn and zoom wherever
 * they are: what the first of them changed is taken back.
 */
import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, MeshBasicMaterial, Plane, TOUCH, Triangle, Vector3 } from "../../vendor/three/three.module.js";
import { Overlay, sides } from "./overlay.js";
import { Neighbours } from "./selecting.js";
import { follow } from "../surface.js";

/** @typedef {"turn" | "paint" | "box" | "part" | "handle" | "point"} Tool */
/** @typedef {import("./overlay.js").Place} Place */
/** @typedef {import("./overlay.js").Box} Box */
/** @typedef {import("./overlay.js").Marks} Marks */
/** @typedef {{ face: number, point: Vector3, place: Place, normal: Vector3 }} Hit `place` as the service has it */

/**
 * @typedef {object} Listeners
 * @property {(faces: number[]) => void} painted more of the stroke under way
 * @property {(box: Box) => void} boxed
 * @property {(part: import("./surface.js").Part) => void} picked
 * @property {(position: Place) => number} held a new handle; returns its number
 * @property {(handle: number, to: Place) => void} moved
 * @property {(handle: number) => void} chosen
 * @property {(place: Place) => void} pointed where a point was clicked
 * @property {(face: number) => void} touched which triangle was clicked with no tool in hand
 * @property {() => void} begun a pointer took hold of something
 * @property {() => void} done the pointer let go of what it changed
 * @property {() => void} dropped what has changed since `begun` was not meant
 */

/** @typedef {{ move?: (moved: PointerEvent) => void, click?: () => void }} Drag `click`: let go where it began */

const STRIDE = 8; // pixels between two dabs of a brush
const MOST_DABS = 16; // for one movement of the pointer
const STILL = 12; // pixels that a click may move

const nothing = () => {};
/** @type {Listeners} */
const DEAF = { painted: nothing, boxed: nothing, picked: nothing, held: () => 0, moved: nothing, chosen: nothing, pointed: nothing, touched: nothing, begun: nothing, done: nothing, dropped: nothing };

export class ControlTools {
  /** @param {import("../viewer.js").MeshViewer} viewer @param {Partial<Listeners>} listeners those of the tools that are used */
  constructor(viewer, listeners) {
    this.viewer = viewer;
    this.listeners = { ...DEAF, ...listeners };
    this.canvas = viewer.surface.canvas;
    this.overlay = new Overlay(viewer.stage.scene);
    /** @type {Tool} */
    this.tool = "turn";
    /** Radius of the brush, as a share of the diagonal. */
    this.brush = 0.05;
    /** @type {import("./surface.js").NumberedSurface | null} */
    this.surface = null;
    /** @type {Neighbours | null} */
    this.neighbours = null;
    /** @type {Box | null} */
    this.box = null;
    /** @type {Marks[]} */
    this.handles = [];
    this.target = new Mesh(new BufferGeometry(), new MeshBasicMaterial({ side: DoubleSide }));
    /** Where the fingers on the view are now, by their pointers. @type {Map<number, PointerEvent>} */
    this.fingers = new Map();
    /** Ends the drag under way as if it had not begun. @type {(() => void) | null} */
    this.drop = null;
    /** Whether the asset was posed since its vertices were read. */
    this.posed = false;
    this.stop = new AbortController();
    viewer.addEventListener("posed", () => this.#posed(), { signal: this.stop.signal });
    const options = { signal: this.stop.signal, capture: true };
    this.canvas.addEventListener("pointerdown", (event) => this.#take(event), options);
    this.canvas.addEventListener("pointermove", (event) => this.#hover(event), options);
    this.canvas.addEventListener("pointerleave", () => this.#brushAt(null), options);
    addEventListener("pointermove", (event) => this.fingers.has(event.pointerId) && this.fingers.set(event.pointerId, event), options);
    for (const type of ["pointerup", "pointercancel"]) addEventListener(type, (event) => this.fingers.delete(/** @type {PointerEvent} */ (event).pointerId), options);
  }

  /** @param {import("./surface.js").NumberedSurface | null} surface of what is loaded */
  setSurface(surface) {
    this.surface = surface;
    this.neighbours = null;
    this.target.geometry.dispose();
    this.target.geometry = new BufferGeometry();
    if (surface) {
      this.target.geometry.setAttribute("position", new BufferAttribute(surface.shown, 3));
      this.target.geometry.setIndex(new BufferAttribute(surface.corners, 1));
    }
    this.overlay.setSurface(surface);
    this.#posed();
    this.viewer.invalidate();
  }

  /** Where nothing is tinted, the vertices are read when someone points at them. */
  #posed() {
    this.posed = this.viewer.clips.length > 0;
    if (this.overlay.tints.some(({ visible }) => visible)) this.#follow();
  }

  /** Have tints and the pointer meet the asset as it is posed. */
  #follow() {
    const { root } = this.viewer;
    if (!this.posed || !this.surface || !root) return;
    this.posed = false;
    this.surface.follow(root);
    this.overlay.follow();
    Object.assign(this.target.geometry, { boundingSphere: null, boundingBox: null });
  }

  /** @returns {Box} around the asset, as the service has it */
  get bounds() {
    const places = this.surface?.places ?? new Float32Array(3);
    const [min, max] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    places.forEach((value, i) => {
      min[i % 3] = Math.min(min[i % 3], value);
      max[i % 3] = Math.max(max[i % 3], value);
    });
    return { min: /** @type {Place} */ (min), max: /** @type {Place} */ (max) };
  }

  /** @param {Tool} tool */
  use(tool) {
    this.tool = tool;
    // Boxes and handles are places of the asset at rest.
    if (tool !== "turn") this.viewer.rest();
    // A finger that paints must not scroll the page.
    this.canvas.style.touchAction = tool === "turn" ? "pan-y" : "none";
    // Where one finger paints, two have to do all that one does otherwise.
    this.viewer.rig.controls.touches.TWO = tool === "turn" ? TOUCH.DOLLY_PAN : TOUCH.DOLLY_ROTATE;
    this.canvas.style.cursor = "";
    this.#brushAt(null);
  }

  /** @param {Uint8Array} kept (F) faces that do not move @param {Uint8Array} pulled (F) those that a prompt with a region pulls at */
  showKept(kept, pulled) {
    this.#follow();
    if (this.surface) {
      this.overlay.setKept(kept, this.surface.corners);
      this.overlay.setPulled(pulled, this.surface.corners);
    }
    this.viewer.invalidate();
  }

  /** @param {Uint8Array} flags (F) faces of a part that is pointed at */
  showPart(flags) {
    this.#follow();
    if (this.surface) this.overlay.setPart(flags, this.surface.corners);
    this.viewer.invalidate();
  }

  /** @param {Box | null} box that is edited @param {Marks[]} handles @param {number} chosen of the handles; -1: none @param {Place[]} points more */
  showMarks(box, handles, chosen, points = []) {
    this.box = box;
    this.handles = handles;
    this.overlay.setMarks(box, [...handles, ...points.map((to) => ({ position: null, to }))], chosen);
    this.viewer.invalidate();
  }

  /** @param {{ clientX: number, clientY: number }} event */
  #aim(event) {
    return this.viewer.surface.cast(event, this.viewer.rig.camera);
  }

  /** @param {{ clientX: number, clientY: number }} event @returns {Hit | null} */
  #hit(event) {
    if (!this.surface) return null;
    this.#follow();
    const caster = this.#aim(event);
    const found = caster.intersectObject(this.target, false)[0];
    if (!found || found.faceIndex === null || found.faceIndex === undefined) return null;
    const { shown, places, corners } = this.surface;
    const face = found.faceIndex;
    const [a, b, c] = [...corners.subarray(3 * face, 3 * face + 3)];
    const at = (/** @type {Float32Array} */ values, /** @type {number} */ v) => new Vector3().fromArray(values, 3 * v);
    const triangle = new Triangle(at(shown, a), at(shown, b), at(shown, c));
    const shares = triangle.getBarycoord(found.point, new Vector3()) ?? new Vector3(1, 0, 0);
    const place = at(places, a).multiplyScalar(shares.x).addScaledVector(at(places, b), shares.y).addScaledVector(at(places, c), shares.z);
    const normal = triangle.getNormal(new Vector3());
    if (normal.dot(caster.ray.direction) > 0) normal.negate();
    return { face, point: found.point, place: /** @type {Place} */ (place.toArray()), normal };
  }

  /** @param {PointerEvent} event @param {Place[]} places @returns {number} the nearest that the pointer is on; -1: none */
  #grip(event, places) {
    return this.viewer.surface.grip(event, places.map((place) => new Vector3().fromArray(place)), this.viewer.rig.camera);
  }

  /** @param {Hit | null} hit */
  #brushAt(hit) {
    this.overlay.setBrush(hit?.point ?? null, hit?.normal, this.brush * this.overlay.diagonal);
    this.viewer.invalidate();
  }

  /** @param {PointerEvent} event */
  #hover(event) {
    if (this.tool === "turn" || event.buttons || event.pointerType === "touch") return;
    const grips = this.tool === "box" && this.box ? sides(this.box) : this.tool === "handle" ? this.handles.map(({ to }) => to) : [];
    const hit = this.tool === "box" ? null : this.#hit(event);
    this.canvas.style.cursor = this.#grip(event, grips) >= 0 ? "grab" : hit ? "crosshair" : "";
    if (this.tool === "paint") this.#brushAt(hit);
    // The arrow of the front must not take the cursor back.
    event.stopImmediatePropagation();
  }

  /** @param {PointerEvent} event */
  #take(event) {
    if (!event.isTrusted) return; // `#handOver` sent it
    const others = [...this.fingers.values()];
    if (event.pointerType === "touch") this.fingers.set(event.pointerId, event);
    if (event.button !== 0) return;
    if (this.tool === "turn") return void (others.length || this.#touch(event));
    if (event.pointerType === "touch" && others.length) return this.#handOver(others);
    this.listeners.begun();
    const drag = { paint: () => this.#paint(event), box: () => this.#dragSide(event), part: () => this.#pick(event), handle: () => this.#dragHandle(event), point: () => this.#point(event) }[this.tool]();
    if (!drag) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    this.viewer.surface.container.focus({ preventScroll: true });
    const drop = () => {
      leave();
      this.drop = null;
      this.#brushAt(null);
      this.listeners.dropped();
    };
    const end = (/** @type {PointerEvent} */ ended) => {
      this.drop = null;
      if (Math.hypot(ended.clientX - event.clientX, ended.clientY - event.clientY) <= STILL) drag.click?.();
      this.listeners.done();
    };
    const leave = follow(event, this.stop.signal, { move: drag.move, end, cancel: drop });
    this.drop = drop;
  }

  /** Let the camera have the fingers that a tool has held; the one that came last is on its way there. @param {PointerEvent[]} fingers */
  #handOver(fingers) {
    if (!this.drop) return;
    this.drop();
    for (const { pointerId, pointerType, isPrimary, clientX, clientY } of fingers) {
      // With its window, or the browser would not count how far the page is scrolled.
      const options = { view: window, pointerId, pointerType, isPrimary, clientX, clientY, button: 0, buttons: 1, bubbles: true, cancelable: true };
      this.canvas.dispatchEvent(new PointerEvent("pointerdown", options));
    }
  }

  /** @param {PointerEvent} event @returns {Drag | null} */
  #paint(event) {
    const { surface } = this;
    const first = this.#hit(event);
    if (!surface || !first) return null;
    this.neighbours ??= new Neighbours(surface);
    const dab = (/** @type {Hit} */ hit) => this.neighbours?.around(hit.face, /** @type {Place} */ (hit.point.toArray()), this.brush * this.overlay.diagonal) ?? [];
    this.#brushAt(first);
    this.listeners.painted(dab(first));
    let [x, y] = [event.clientX, event.clientY];
    const move = (/** @type {PointerEvent} */ moved) => {
      const count = Math.min(MOST_DABS, Math.max(1, Math.round(Math.hypot(moved.clientX - x, moved.clientY - y) / STRIDE)));
      /** @type {Set<number>} */
      const faces = new Set();
      let last = null;
      for (let i = 1; i <= count; i++) {
        last = this.#hit({ clientX: x + ((moved.clientX - x) * i) / count, clientY: y + ((moved.clientY - y) * i) / count });
        if (last) for (const face of dab(last)) faces.add(face);
      }
      [x, y] = [moved.clientX, moved.clientY];
      this.#brushAt(last);
      if (faces.size) this.listeners.painted([...faces]);
    };
    return { move };
  }

  /** @param {PointerEvent} event @returns {Drag | null} */
  #dragSide(event) {
    const { box } = this;
    const side = box ? this.#grip(event, sides(box)) : -1;
    if (!box || side < 0) return null;
    const [axis, end] = [side >> 1, side & 1 ? /** @type {const} */ ("max") : /** @type {const} */ ("min")];
    const grip = new Vector3().fromArray(sides(box)[side]);
    const along = new Vector3().setComponent(axis, 1);
    const move = (/** @type {PointerEvent} */ moved) => {
      const { origin, direction } = this.#aim(moved).ray;
      // The point of the side's axis that is nearest to the pointer's ray.
      const between = grip.clone().sub(origin);
      const cosine = along.dot(direction);
      const away = 1 - cosine * cosine;
      if (away < 1e-4) return;
      const value = grip.getComponent(axis) + (cosine * between.dot(direction) - between.dot(along)) / away;
      const next = { min: /** @type {Place} */ ([...box.min]), max: /** @type {Place} */ ([...box.max]) };
      next[end][axis] = end === "min" ? Math.min(value, box.max[axis]) : Math.max(value, box.min[axis]);
      this.listeners.boxed(next);
    };
    return { move };
  }

  /** @param {PointerEvent} event @returns {Drag | null} */
  #pick(event) {
    const { surface } = this;
    const hit = this.#hit(event);
    return hit && surface && { click: () => this.listeners.picked(surface.partOf(hit.face)) };
  }

  /** @param {PointerEvent} event @returns {Drag | null} */
  #point(event) {
    const hit = this.#hit(event);
    return hit && { click: () => this.listeners.pointed(hit.place) };
  }

  /** Turning the view goes on meanwhile. @param {PointerEvent} event */
  #touch(event) {
    const mine = (/** @type {PointerEvent} */ ended) => {
      const still = ended.pointerId === event.pointerId && Math.hypot(ended.clientX - event.clientX, ended.clientY - event.clientY) <= STILL;
      const hit = still && !this.fingers.size ? this.#hit(ended) : null;
      if (hit) this.listeners.touched(hit.face);
    };
    addEventListener("pointerup", mine, { once: true, signal: this.stop.signal });
  }

  /** @param {PointerEvent} event @returns {Drag | null} */
  #dragHandle(event) {
    let handle = this.#grip(event, this.handles.map(({ to }) => to));
    if (handle >= 0) this.listeners.chosen(handle);
    else {
      const hit = this.#hit(event);
      if (!hit) return null;
      handle = this.listeners.held(hit.place);
    }
    const start = new Vector3().fromArray(this.handles[handle].to);
    const plane = new Plane().setFromNormalAndCoplanarPoint(this.viewer.rig.camera.getWorldDirection(new Vector3()), start);
    const from = this.#aim(event).ray.intersectPlane(plane, new Vector3()) ?? start;
    const move = (/** @type {PointerEvent} */ moved) => {
      const now = this.#aim(moved).ray.intersectPlane(plane, new Vector3());
      if (now) this.listeners.moved(handle, start.clone().add(now).sub(from).toArray());
    };
    return { move };
  }

  dispose() {
    this.stop.abort();
    this.overlay.dispose();
    this.target.geometry.dispose();
    this.target.material.dispose();
  }
}
