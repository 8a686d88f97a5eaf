// @ts-check
/** One turn around what a viewer shows, as an animated picture. */
import { Box3, Vector3 } from "../vendor/three/three.module.js";
import { frameBox, makeCamera } from "./cameras.js";
import { drawSnapshot } from "./snapshot.js";
import { animatedWebp } from "./webp.js";

/** @typedef {{ size?: number, frames?: number, background?: string, signal?: AbortSignal }} TurntableOptions */

const FRAME_MS = 80;
const QUALITY = 0.85;

/**
 * @param {import("./renderer.js").SharedRenderer} renderer
 * @param {import("./stage.js").Stage} stage
 * @param {Box3} box what fits into every frame
 * @param {Vector3} direction from the box to the camera in the first frame
 * @param {TurntableOptions} options `background` is a CSS colour
 * @returns {Promise<Blob>} a WebP
 * @throws {Error} the browser cannot write WebP; the message is for people
 */
export async function drawTurntable(renderer, stage, box, direction, { size = 420, frames = 36, background = "white", signal } = {}) {
  const camera = makeCamera();
  const around = cylinder(box);
  const way = direction.clone().normalize();
  const stills = [];
  for (let frame = 0; frame < frames; frame++) {
    signal?.throwIfAborted();
    frameBox(camera, around, way);
    const still = await drawSnapshot(renderer, stage, camera, { width: size, height: size, background, type: "image/webp", quality: QUALITY });
    stills.push(await still.arrayBuffer());
    way.applyAxisAngle(new Vector3(0, 1, 0), (-2 * Math.PI) / frames);
  }
  const made = animatedWebp(stills, { width: size, height: size, milliseconds: FRAME_MS });
  return new Blob([made], { type: "image/webp" });
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
