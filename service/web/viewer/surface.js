// @ts-check
/** The element that a viewer lives in: a canvas of the right size, a theme, a name for those who do not see it. */

import { Raycaster, Vector2 } from "../vendor/three/three.module.js";

const MAX_PIXEL_RATIO = 2;
let count = 0;

/** @typedef {{ resized: (aspect: number) => void, changed: () => void, themed: (dark: boolean) => void }} Listeners */

/**
 * Follow the pointer that went down until it is let go.
 * @param {PointerEvent} event
 * @param {AbortSignal} signal ends it without a word
 * @param {{ move?: (moved: PointerEvent) => void, end: (ended: PointerEvent) => void, cancel?: (ended: PointerEvent) => void }} does
 * @returns {() => void} ends it without a word
 */
export function follow(event, signal, { move, end, cancel }) {
  const following = new AbortController();
  const on = (/** @type {"pointermove" | "pointerup" | "pointercancel"} */ type, /** @type {((event: PointerEvent) => void) | undefined} */ act) =>
    addEventListener(type, (other) => {
      if (other.pointerId !== event.pointerId) return;
      if (type !== "pointermove") following.abort();
      act?.(other);
    }, { signal: AbortSignal.any([following.signal, signal]) });
  on("pointermove", move);
  on("pointerup", end);
  on("pointercancel", cancel);
  return () => following.abort();
}

/** @param {string} colour of any CSS syntax @returns {number[]} red, green, blue and alpha, to 255 */
function channels(colour) {
  const context = /** @type {CanvasRenderingContext2D} */ (Object.assign(document.createElement("canvas"), { width: 1, height: 1 }).getContext("2d"));
  context.fillStyle = colour;
  context.fillRect(0, 0, 1, 1);
  return [...context.getImageData(0, 0, 1, 1).data];
}

/** @param {number[]} channels */
function luma([red, green, blue]) {
  return 0.299 * red + 0.587 * green + 0.114 * blue;
}

export class Surface {
  /** @param {HTMLElement} container @param {string} label @param {string} instructions @param {Listeners} listeners */
  constructor(container, label, instructions, listeners) {
    this.container = container;
    this.listeners = listeners;
    this.visible = true;
    this.canvas = document.createElement("canvas");
    const context = this.canvas.getContext("2d");
    if (!context) throw new Error("This browser has no 2D canvas.");
    this.context = context;
    this.help = document.createElement("p");
    this.help.id = `mesh-viewer-help-${++count}`;
    this.help.textContent = instructions;
    container.tabIndex = 0;
    container.setAttribute("role", "application");
    container.setAttribute("aria-roledescription", "3D viewer");
    container.setAttribute("aria-label", label);
    container.setAttribute("aria-describedby", this.help.id);
    this.canvas.setAttribute("aria-hidden", "true");
    // Through the object model: style attributes and elements are not allowed by the page's policy.
    if (getComputedStyle(container).position === "static") container.style.position = "relative";
    Object.assign(this.canvas.style, { position: "absolute", inset: "0", width: "100%", height: "100%", display: "block" });
    Object.assign(this.help.style, { position: "absolute", width: "1px", height: "1px", overflow: "hidden", clipPath: "inset(50%)", margin: "0" });
    container.style.backgroundColor = "var(--viewer-background, light-dark(#eef0f3, #2a2d33))";
    container.style.backgroundImage =
      "radial-gradient(ellipse at 50% 42%, transparent 30%, var(--viewer-background-edge, light-dark(#c9cdd4, #15171a)) 115%)";
    container.append(this.canvas, this.help);
    this.stop = new AbortController();
  }

  /** Begin to watch size, visibility and theme. */
  observe() {
    const { signal } = this.stop;
    this.resizing = new ResizeObserver(() => {
      this.listeners.resized(this.aspect);
      this.listeners.changed();
    });
    this.resizing.observe(this.container);
    this.intersecting = new IntersectionObserver((entries) => {
      this.visible = entries.at(-1)?.isIntersecting ?? true;
      if (this.visible) this.listeners.changed();
    });
    this.intersecting.observe(this.container);
    this.retheme();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.retheme(), { signal });
    // The wheel scrolls the page until someone has chosen the viewer.
    this.container.addEventListener("pointerdown", () => this.container.focus({ preventScroll: true }), { signal });
    const wheel = (/** @type {WheelEvent} */ event) => {
      const { activeElement } = /** @type {Document | ShadowRoot} */ (this.container.getRootNode());
      if (!event.ctrlKey && activeElement !== this.container) event.stopPropagation();
    };
    this.container.addEventListener("wheel", wheel, { signal, capture: true, passive: true });
  }

  /** @returns {number} width / height */
  get aspect() {
    const { clientWidth, clientHeight } = this.container;
    return clientWidth && clientHeight ? clientWidth / clientHeight : 1;
  }

  /** @param {{ clientX: number, clientY: number }} event @returns {[number, number]} in the picture, each from -1 to 1, up being positive */
  aim({ clientX, clientY }) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    return [(2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height];
  }

  /** @param {{ clientX: number, clientY: number }} event @param {import("three").Camera} camera @returns {Raycaster} through the pointer */
  cast(event, camera) {
    const caster = new Raycaster();
    camera.updateMatrixWorld();
    caster.setFromCamera(new Vector2(...this.aim(event)), camera);
    return caster;
  }

  /** Draw for the colours that are there now. */
  retheme() {
    this.listeners.themed(this.dark);
    this.listeners.changed();
  }

  /** @returns {boolean} whether the background is dark; one that is not there is that of the text around it */
  get dark() {
    const { backgroundColor, color } = getComputedStyle(this.container);
    const [ground, text] = [backgroundColor, color].map(channels);
    return ground[3] < 128 ? luma(text) > 128 : luma(ground) < 128;
  }

  /** Give the canvas as many pixels as it covers. @param {number} limit @returns {boolean} false where there are none */
  fit(limit) {
    const { clientWidth, clientHeight } = this.container;
    const ratio = Math.min(devicePixelRatio || 1, MAX_PIXEL_RATIO, limit / Math.max(clientWidth, clientHeight, 1));
    const [width, height] = [Math.round(clientWidth * ratio), Math.round(clientHeight * ratio)];
    if (!width || !height) return false;
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    return true;
  }

  dispose() {
    this.stop.abort();
    this.resizing?.disconnect();
    this.intersecting?.disconnect();
    this.canvas.remove();
    this.help.remove();
  }
}
