// @ts-check
/** One turn around what a viewer shows, as a GIF, or as the video that the browser records. */
import { Box3, Vector3 } from "../vendor/three/three.module.js";
import { frameBox, makeCamera } from "./cameras.js";
import { paint } from "./snapshot.js";

/** @typedef {"gif" | "webm" | "mp4"} Moving */
/**
 * @typedef {object} TurntableOptions
 * @property {Moving} [kind] without it a video, where the browser records one
 * @property {string} [background] a CSS colour
 * @property {AbortSignal} [signal]
 * @property {(seconds: number) => void} [moment] poses the asset, before each picture
 * @property {(share: number) => void} [progress]
 */

const SIZE = 480;
const FRAMES = 48;
const FRAME_MS = 60; // GIFs count in hundredths of a second
const BITS_PER_SECOND = 6_000_000;
const COLOURS = 256; // of a GIF
const VIDEOS = /** @type {const} */ (["webm", "mp4"]);

/** @returns {Moving[]} what can be written here: a GIF always, and a video where the browser records one */
export function movingKinds() {
  const able = typeof MediaRecorder === "function" && "captureStream" in HTMLCanvasElement.prototype;
  const video = able && VIDEOS.find((kind) => MediaRecorder.isTypeSupported(`video/${kind}`));
  return video ? ["gif", video] : ["gif"];
}

/**
 * @param {import("./renderer.js").SharedRenderer} renderer
 * @param {import("./stage.js").Stage} stage
 * @param {Box3} box what fits into every frame
 * @param {Vector3} direction from the box to the camera in the first frame
 * @param {TurntableOptions} options
 * @returns {Promise<Blob>}
 * @throws {Error} this browser does not record the kind
 */
export async function drawTurntable(renderer, stage, box, direction, { kind = movingKinds().at(-1), background = "white", signal, moment, progress } = {}) {
  const camera = makeCamera();
  const around = cylinder(box);
  const way = direction.clone().normalize();
  const canvas = Object.assign(document.createElement("canvas"), { width: SIZE, height: SIZE });
  const draw = (/** @type {number} */ frame) => {
    moment?.((frame * FRAME_MS) / 1000);
    frameBox(camera, around, way);
    paint(renderer, stage, camera, canvas, background);
  };
  draw(0); // a canvas without a context cannot be recorded
  const take = await (kind === "gif" ? gifOf(canvas) : videoOf(canvas, kind));
  for (let frame = 0; frame < FRAMES; frame++) {
    signal?.throwIfAborted();
    if (renderer.lost) throw new Error("The graphics card was lost for the moment; try again.");
    draw(frame);
    way.applyAxisAngle(new Vector3(0, 1, 0), (-2 * Math.PI) / FRAMES);
    await take.frame();
    progress?.((frame + 1) / FRAMES);
  }
  return take.end();
}

/** @typedef {{ frame: () => Promise<unknown>, end: () => Promise<Blob> }} Take frames of a canvas, one after the other */

/** A pause in which the page can do other things. @param {number} milliseconds */
function pause(milliseconds) {
  return new Promise((resolve) => setTimeout(resolve, milliseconds));
}

/** @param {HTMLCanvasElement} canvas @returns {Promise<Take>} */
async function gifOf(canvas) {
  const { GIFEncoder, quantize, applyPalette } = await import("../vendor/gifenc/gifenc.js");
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const gif = GIFEncoder();
  return {
    frame() {
      const { data } = context.getImageData(0, 0, SIZE, SIZE);
      const palette = quantize(data, COLOURS);
      gif.writeFrame(applyPalette(data, palette), SIZE, SIZE, { palette, delay: FRAME_MS });
      return pause(0);
    },
    async end() {
      gif.finish();
      return new Blob([gif.bytes()], { type: "image/gif" });
    },
  };
}

/** @param {HTMLCanvasElement} canvas @param {Moving} [kind] @returns {Promise<Take>} */
async function videoOf(canvas, kind) {
  if (!kind || !movingKinds().includes(kind)) throw new Error("This browser records no video. Save a GIF.");
  const recorder = new MediaRecorder(canvas.captureStream(), { mimeType: `video/${kind}`, videoBitsPerSecond: BITS_PER_SECOND });
  /** @type {Blob[]} */
  const pieces = [];
  recorder.addEventListener("dataavailable", ({ data }) => pieces.push(data));
  const stopped = new Promise((resolve) => recorder.addEventListener("stop", resolve, { once: true }));
  recorder.start();
  return {
    frame: () => pause(FRAME_MS), // it is recorded as it is shown
    async end() {
      recorder.stop();
      await stopped;
      return new Blob(pieces, { type: recorder.mimeType });
    },
  };
}

/** @param {Box3} box @returns {Box3} the box around it in every turn about the vertical axis */
function cylinder(box) {
  const center = box.getCenter(new Vector3());
  const size = box.getSize(new Vector3());
  const radius = Math.hypot(size.x, size.z) / 2;
  // A box with these sides, seen along its diagonal, would be wider than the cylinder that it stands for.
  const half = new Vector3(radius * Math.SQRT1_2, size.y / 2, radius * Math.SQRT1_2);
  return new Box3(center.clone().sub(half), center.clone().add(half));
}
