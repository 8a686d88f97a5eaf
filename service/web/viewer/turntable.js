// @ts-check
/** One turn around what a viewer shows, as a video. */
import { Box3, Vector3 } from "../vendor/three/three.module.js";
import { frameBox, makeCamera } from "./cameras.js";
import { paint } from "./snapshot.js";

/** @typedef {{ background?: string, signal?: AbortSignal }} TurntableOptions */

const SIZE = 480;
const FRAMES = 48;
const FRAME_MS = 60;
const BITS_PER_SECOND = 6_000_000;

/**
 * @param {import("./renderer.js").SharedRenderer} renderer
 * @param {import("./stage.js").Stage} stage
 * @param {Box3} box what fits into every frame
 * @param {Vector3} direction from the box to the camera in the first frame
 * @param {TurntableOptions} options `background` is a CSS colour
 * @returns {Promise<Blob>} as the browser records it: a WebM, or an MP4
 */
export async function drawTurntable(renderer, stage, box, direction, { background = "white", signal } = {}) {
  const camera = makeCamera();
  const around = cylinder(box);
  const way = direction.clone().normalize();
  const canvas = Object.assign(document.createElement("canvas"), { width: SIZE, height: SIZE });
  paint(renderer, stage, camera, canvas, background); // a canvas without a context cannot be recorded
  const recorder = new MediaRecorder(canvas.captureStream(), { videoBitsPerSecond: BITS_PER_SECOND });
  /** @type {Blob[]} */
  const parts = [];
  recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
  const stopped = new Promise((resolve) => recorder.addEventListener("stop", resolve, { once: true }));
  recorder.start();
  for (let frame = 0; frame < FRAMES; frame++) {
    signal?.throwIfAborted();
    frameBox(camera, around, way);
    paint(renderer, stage, camera, canvas, background);
    way.applyAxisAngle(new Vector3(0, 1, 0), (-2 * Math.PI) / FRAMES);
    await new Promise((resolve) => setTimeout(resolve, FRAME_MS));
  }
  recorder.stop();
  await stopped;
  return new Blob(parts, { type: recorder.mimeType });
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
