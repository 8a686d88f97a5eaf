// @ts-check
/** A field in a viewer: its levels, distances from a point as colours with isolines, and the point, which can be dragged. */
import { BufferAttribute, Mesh, MeshBasicMaterial, SphereGeometry, Vector3 } from "../vendor/three/three.module.js";
import { cssGradient, pieceColors, ticks } from "./colormaps.js";
import { colorTexture, HeatMaterial, pieceTexture } from "./heatmap.js";
import { meshesOf } from "./loading.js";
import { follow } from "./surface.js";

const ISOLINES = 24;
const STILL = 4; // pixels: what moves less is a click

/** Tasks for `field-worker.js`, each a promise. */
export class FieldWorker {
  constructor() {
    this.worker = new Worker(new URL("field-worker.js", import.meta.url), { type: "module" });
    /** @type {Map<number, { resolve: (answer: any) => void, reject: (error: Error) => void }>} */
    this.open = new Map();
    this.last = 0;
    this.worker.addEventListener("message", ({ data: { id, error, ...answer } }) => {
      const waiting = this.open.get(id);
      this.open.delete(id);
      if (error) waiting?.reject(new Error(error));
      else waiting?.resolve(answer);
    });
    this.worker.addEventListener("error", (event) => {
      for (const { reject } of this.open.values()) reject(new Error(event.message || "The script that unfolds it could not be loaded."));
      this.open.clear();
    });
  }

  /**
   * @param {"open" | "level" | "heat" | "scalar"} task
   * @param {Record<string, unknown>} given
   * @param {Transferable[]} [owned] what the worker gets for itself
   * @returns {Promise<any>} as the worker describes it
   */
  ask(task, given, owned = []) {
    const id = ++this.last;
    return new Promise((resolve, reject) => {
      this.open.set(id, { resolve, reject });
      this.worker.postMessage({ id, task, ...given }, owned);
    });
  }

  dispose() {
    this.worker.terminate();
    this.open.clear();
  }
}

export class FieldView {
  /** @param {import("./viewer.js").MeshViewer} viewer @param {(place: number[]) => void} onSource where the pointer put the source */
  constructor(viewer, onSource) {
    this.viewer = viewer;
    this.onSource = onSource;
    this.canvas = viewer.surface.canvas;
    this.stop = new AbortController();
    /** @type {import("three").Material | null} */
    this.plain = null;
    this.material = new HeatMaterial(colorTexture("viridis"), false, ISOLINES);
    /** @type {Record<number, HeatMaterial>} By how many pieces there are. */
    this.divided = {};
    this.marker = new Mesh(new SphereGeometry(1, 20, 14), new MeshBasicMaterial({ color: 0xd9622b, toneMapped: false, depthTest: false, transparent: true }));
    this.marker.userData.overlay = true; // no shadow, and no part of the surface
    this.marker.renderOrder = 2;
    this.marker.visible = false;
    viewer.stage.scene.add(this.marker);
    const options = { signal: this.stop.signal, capture: true };
    this.canvas.addEventListener("pointerdown", (event) => this.#down(event), options);
    this.canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) this.canvas.style.cursor = this.#grips(event) ? "grab" : "";
    }, options);
  }

  /** @returns {import("three").Mesh | null} */
  get mesh() {
    return this.viewer.root ? (meshesOf(this.viewer.root)[0] ?? null) : null;
  }

  /** Colour the surface. @param {Float32Array | null} values of its vertices, 0 to `most`; null: as it is @param {number} most */
  colour(values, most) {
    if (!values) return this.#dress(null, null);
    const heat = Float32Array.from(values, (value) => (Number.isFinite(value) ? value / (most || 1) : -1));
    this.#dress(heat, this.material);
  }

  /** Colour the surface by pieces. @param {Float32Array} values of its vertices: numbers below `count` @param {number} count */
  divide(values, count) {
    const material = (this.divided[count] ??= new HeatMaterial(pieceTexture(count), false, 0, true));
    this.#dress(values.map((piece) => (piece + 0.5) / count), material);
  }

  /** @param {Float32Array | null} heat @param {HeatMaterial | null} material */
  #dress(heat, material) {
    const { mesh } = this;
    if (!mesh) return;
    if (!(mesh.material instanceof HeatMaterial)) this.plain = /** @type {import("three").Material} */ (mesh.material);
    if (heat) mesh.geometry.setAttribute("heat", new BufferAttribute(heat, 1));
    mesh.material = material ?? this.plain ?? mesh.material;
    this.viewer.invalidate();
  }

  /**
   * What the colours mean.
   * @param {string} label
   * @param {{ least: number, most: number }} values
   * @param {string} [unit]
   * @returns {import("../app/viewer-box.js").Scale}
   */
  scale(label, { least, most }, unit = "") {
    const marks = ticks({ range: [least, most], scale: "linear" });
    return { min: least, max: most, p99: most, unit, label, gradient: cssGradient("viridis"), ticks: marks, problem: "" };
  }

  /** What the colours of pieces mean. @param {string} label @param {number[]} labels @returns {import("../app/viewer-box.js").Scale} */
  pieceScale(label, labels) {
    const count = labels.length;
    const stops = pieceColors(count).map((color, i) => `rgb(${color}) ${(100 * i) / count}% ${(100 * (i + 1)) / count}%`);
    const every = Math.ceil(count / 8);
    const marks = labels.map((value, i) => ({ text: String(value), at: (i + 0.5) / count })).filter((_, i) => i % every === 0);
    const [min, max] = [labels[0], labels[count - 1]];
    return { min, max, p99: max, unit: "", label, gradient: `linear-gradient(to right, ${stops})`, ticks: marks, problem: "" };
  }

  /** Show where the source is. @param {number[] | null} place */
  mark(place) {
    this.marker.visible = place !== null;
    if (place) this.marker.position.fromArray(place);
    const size = this.viewer.ownBox.getSize(new Vector3()).length();
    this.marker.scale.setScalar(0.011 * size);
    this.viewer.invalidate();
  }

  /** @param {{ clientX: number, clientY: number }} event @returns {number[] | null} the place on the surface below the pointer */
  placeAt(event) {
    const { mesh } = this;
    if (!mesh) return null;
    return this.viewer.surface.cast(event, this.viewer.rig.camera).intersectObject(mesh, false)[0]?.point.toArray() ?? null;
  }

  /** @param {PointerEvent} event @returns {boolean} whether the pointer is on the source */
  #grips(event) {
    return this.marker.visible && this.viewer.surface.grip(event, [this.marker.position], this.viewer.rig.camera) === 0;
  }

  /** A click puts the source somewhere; from where it is, it is dragged. What begins elsewhere turns the camera. @param {PointerEvent} event */
  #down(event) {
    if (event.button !== 0 || !event.isPrimary) return;
    const drags = this.#grips(event);
    if (drags) {
      event.stopImmediatePropagation();
      event.preventDefault();
      this.viewer.surface.container.focus({ preventScroll: true });
      this.canvas.style.cursor = "grabbing";
    }
    let far = false;
    const move = (/** @type {PointerEvent} */ moved) => {
      far ||= Math.hypot(moved.clientX - event.clientX, moved.clientY - event.clientY) > STILL;
      const place = drags ? this.placeAt(moved) : null;
      if (place) this.onSource(place);
    };
    const end = (/** @type {PointerEvent} */ ended) => {
      this.canvas.style.cursor = "";
      const place = drags || far ? null : this.placeAt(ended);
      if (place) this.onSource(place);
    };
    follow(event, this.stop.signal, { move, end });
  }

  dispose() {
    this.stop.abort();
    this.marker.removeFromParent();
    this.marker.geometry.dispose();
    /** @type {import("three").Material} */ (this.marker.material).dispose();
    for (const material of [this.material, ...Object.values(this.divided)]) material.dispose();
  }
}
