// @ts-check
/**
 * Point at an asset, or paint its faces. What the brush takes hold of does not turn the camera; beside it, the pointer turns
 * it as ever. Two fingers turn and zoom wherever they are: what the first of them painted is taken back.
 */
import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, MeshBasicMaterial, TOUCH, Triangle, Vector3 } from "../../vendor/three/three.module.js";
import { Overlay } from "./overlay.js";
import { Neighbours } from "./selecting.js";
import { follow } from "../surface.js";

/** @typedef {"turn" | "paint"} Tool */
/** @typedef {[number, number, number]} Point */
/** @typedef {{ face: number, point: Vector3, normal: Vector3 }} Hit */

/**
 * @typedef {object} Listeners
 * @property {(faces: number[]) => void} painted more of the stroke under way
 * @property {(face: number) => void} touched which triangle was clicked with no tool in hand
 * @property {() => void} begun a stroke begins
 * @property {() => void} done it has ended
 * @property {() => void} dropped what has changed since `begun` was not meant
 */

const STRIDE = 8; // pixels between two dabs of a brush
const MOST_DABS = 16; // for one movement of the pointer
const STILL = 12; // pixels that a click may move

const nothing = () => {};
/** @type {Listeners} */
const DEAF = { painted: nothing, touched: nothing, begun: nothing, done: nothing, dropped: nothing };

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

  /** @param {Tool} tool */
  use(tool) {
    this.tool = tool;
    // What is painted is the asset at rest.
    if (tool !== "turn") this.viewer.rest();
    // A finger that paints must not scroll the page.
    this.canvas.style.touchAction = tool === "turn" ? "pan-y" : "none";
    // Where one finger paints, two have to do all that one does otherwise.
    this.viewer.rig.orbit.touches.TWO = tool === "turn" ? TOUCH.DOLLY_PAN : TOUCH.DOLLY_ROTATE;
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

  /** @param {{ clientX: number, clientY: number }} event @returns {Hit | null} */
  #hit(event) {
    if (!this.surface) return null;
    this.#follow();
    const caster = this.viewer.surface.cast(event, this.viewer.rig.camera);
    const found = caster.intersectObject(this.target, false)[0];
    if (!found || found.faceIndex === null || found.faceIndex === undefined) return null;
    const { shown, corners } = this.surface;
    const face = found.faceIndex;
    const [a, b, c] = [...corners.subarray(3 * face, 3 * face + 3)];
    const at = (/** @type {number} */ v) => new Vector3().fromArray(shown, 3 * v);
    const normal = new Triangle(at(a), at(b), at(c)).getNormal(new Vector3());
    if (normal.dot(caster.ray.direction) > 0) normal.negate();
    return { face, point: found.point, normal };
  }

  /** @param {Hit | null} hit */
  #brushAt(hit) {
    this.overlay.setBrush(hit?.point ?? null, hit?.normal, this.brush * this.overlay.diagonal);
    this.viewer.invalidate();
  }

  /** @param {PointerEvent} event */
  #hover(event) {
    if (this.tool === "turn" || event.buttons || event.pointerType === "touch") return;
    const hit = this.#hit(event);
    this.canvas.style.cursor = hit ? "crosshair" : "";
    this.#brushAt(hit);
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
    const move = this.#paint(event);
    if (!move) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    this.viewer.surface.container.focus({ preventScroll: true });
    const drop = () => {
      leave();
      this.drop = null;
      this.#brushAt(null);
      this.listeners.dropped();
    };
    const end = () => {
      this.drop = null;
      this.listeners.done();
    };
    const leave = follow(event, this.stop.signal, { move, end, cancel: drop });
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

  /** @param {PointerEvent} event @returns {((moved: PointerEvent) => void) | null} what goes on with the stroke; null: it begins beside the asset */
  #paint(event) {
    const { surface } = this;
    const first = this.#hit(event);
    if (!surface || !first) return null;
    this.neighbours ??= new Neighbours(surface);
    const dab = (/** @type {Hit} */ hit) => this.neighbours?.around(hit.face, /** @type {Point} */ (hit.point.toArray()), this.brush * this.overlay.diagonal) ?? [];
    this.#brushAt(first);
    this.listeners.painted(dab(first));
    let [x, y] = [event.clientX, event.clientY];
    return (/** @type {PointerEvent} */ moved) => {
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

  dispose() {
    this.stop.abort();
    this.overlay.dispose();
    this.target.geometry.dispose();
    this.target.material.dispose();
  }
}
