// @ts-check
/**
 * One WebGL context for every viewer of the page: browsers allow about sixteen, and a page of jobs shows more meshes
 * than that. Each viewer has a plain 2D canvas; the shared one draws its scene and the picture is copied over, on
 * demand only.
 */
import { NeutralToneMapping, VSMShadowMap, PMREMGenerator, WebGLRenderer } from "../vendor/three/three.module.js";
import { RoomEnvironment } from "../vendor/three/addons/environments/RoomEnvironment.js";

const NO_WEBGL =
  "This browser cannot draw 3D: WebGL 2 is switched off or missing. Update the browser, or allow hardware acceleration.";

/** @type {SharedRenderer | null} */
let shared = null;
let users = 0;

/**
 * Use the shared renderer; each call needs one `releaseRenderer`.
 * @returns {SharedRenderer}
 * @throws {Error} there is no WebGL 2; the message is for people
 */
export function acquireRenderer() {
  shared ??= new SharedRenderer();
  users++;
  return shared;
}

/** Use it no more; with the last user the WebGL context is freed. */
export function releaseRenderer() {
  if (--users > 0 || !shared) return;
  shared.dispose();
  shared = null;
}

/** @returns {number} WebGL contexts in use: 0 or 1 */
export function contextCount() {
  return shared ? 1 : 0;
}

/** Draws scenes into 2D canvases, a frame at a time, for those that asked. */
export class SharedRenderer extends EventTarget {
  constructor() {
    super();
    const canvas = document.createElement("canvas");
    const attributes = { alpha: true, antialias: true, depth: true, stencil: false, premultipliedAlpha: true };
    const context = /** @type {WebGL2RenderingContext | null} */ (canvas.getContext("webgl2", attributes));
    if (!context) throw Object.assign(new Error(NO_WEBGL), { name: "NoWebGL" });
    this.canvas = canvas;
    this.gl = new WebGLRenderer({ canvas, context, ...attributes });
    this.gl.setPixelRatio(1);
    this.gl.setClearColor(0x000000, 0);
    this.gl.toneMapping = NeutralToneMapping;
    this.gl.toneMappingExposure = 0.92;
    this.gl.shadowMap.enabled = true;
    this.gl.shadowMap.type = VSMShadowMap;
    this.maxSize = Math.min(4096, context.getParameter(context.MAX_RENDERBUFFER_SIZE));
    /** @type {Set<() => boolean>} */
    this.waiting = new Set();
    this.frame = 0;
    this.environment = makeEnvironment(this.gl);
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault()); // or it is never given back
    canvas.addEventListener("webglcontextrestored", () => {
      this.environment = makeEnvironment(this.gl); // what was drawn on the GPU is gone
      this.dispatchEvent(new Event("contextrestored"));
    });
  }

  /** @returns {boolean} whether the context is gone; true before the event says so */
  get lost() {
    return this.gl.getContext().isContextLost();
  }

  /** Call back before the next picture. @param {() => boolean} draw returns whether it wants another frame after this one */
  request(draw) {
    this.waiting.add(draw);
    if (!this.frame) this.frame = requestAnimationFrame(() => this.#run());
  }

  /** @param {() => boolean} draw */
  cancel(draw) {
    this.waiting.delete(draw);
  }

  #run() {
    this.frame = 0;
    const turn = [...this.waiting];
    this.waiting.clear();
    for (const draw of turn) if (draw()) this.request(draw);
  }

  /**
   * Draw a scene and copy it into a 2D canvas of the given size; what was there is replaced.
   * @param {import("./stage.js").Stage} stage
   * @param {import("three").Camera} camera
   * @param {CanvasRenderingContext2D | OffscreenCanvasRenderingContext2D} target
   * @param {number} width pixels, at most `maxSize`
   * @param {number} height
   */
  draw(stage, camera, target, width, height) {
    if (this.lost) return;
    const grownWidth = Math.max(this.canvas.width, width);
    const grownHeight = Math.max(this.canvas.height, height);
    if (grownWidth !== this.canvas.width || grownHeight !== this.canvas.height) {
      this.gl.setSize(grownWidth, grownHeight, false);
    }
    this.gl.setViewport(0, 0, width, height);
    this.gl.setScissor(0, 0, width, height);
    this.gl.setScissorTest(true);
    this.gl.render(stage.scene, camera);
    target.drawImage(this.canvas, 0, this.canvas.height - height, width, height, 0, 0, width, height);
  }

  dispose() {
    cancelAnimationFrame(this.frame);
    this.waiting.clear();
    this.environment.dispose();
    this.gl.dispose();
    this.gl.forceContextLoss();
  }
}

/** Light from all around: soft boxes in a room, as a prefiltered cube map. @param {WebGLRenderer} gl */
function makeEnvironment(gl) {
  const generator = new PMREMGenerator(gl);
  const room = new RoomEnvironment();
  const target = generator.fromScene(room, 0.04);
  room.dispose();
  generator.dispose();
  return target;
}
