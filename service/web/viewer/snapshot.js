// @ts-check
/** Pictures of meshes as PNG files, drawn by the shared renderer: a sheet of many needs no more than one context. */
import { Box3 } from "../vendor/three/three.module.js";
import { defaultDirection, frameBox, makeCamera } from "./cameras.js";
import { disposeAsset, parseAsset } from "./loading.js";
import { acquireRenderer, releaseRenderer } from "./renderer.js";
import { boundsOf, dress, Stage } from "./stage.js";

/** @typedef {{ width?: number, height?: number, background?: string }} SnapshotOptions `background` is a CSS colour */

/**
 * Fill a canvas with a scene.
 * @param {import("./renderer.js").SharedRenderer} renderer
 * @param {Stage} stage
 * @param {import("three").PerspectiveCamera} camera
 * @param {HTMLCanvasElement} canvas
 * @param {string} [background] without one it is transparent around the mesh
 */
export function paint(renderer, stage, camera, canvas, background) {
  const target = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const { width, height } = canvas;
  const { aspect } = camera;
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  if (background) {
    target.fillStyle = background;
    target.fillRect(0, 0, width, height);
  }
  renderer.draw(stage, camera, target, width, height);
  camera.aspect = aspect;
  camera.updateProjectionMatrix();
}

/**
 * Draw a scene once.
 * @param {import("./renderer.js").SharedRenderer} renderer
 * @param {Stage} stage
 * @param {import("three").PerspectiveCamera} camera
 * @param {SnapshotOptions} options
 * @returns {Promise<Blob>} PNG
 */
export async function drawSnapshot(renderer, stage, camera, { width = 512, height = 512, background } = {}) {
  const limit = renderer.maxSize;
  if (!(width >= 1 && height >= 1 && width <= limit && height <= limit)) {
    throw new Error(`A picture can be 1 to ${limit} pixels wide and high, not ${width} × ${height}.`);
  }
  if (renderer.lost) throw new Error("The graphics card was lost for the moment; try again.");
  const canvas = Object.assign(document.createElement("canvas"), { width: Math.round(width), height: Math.round(height) });
  paint(renderer, stage, camera, canvas, background);
  return new Promise((resolve, reject) => {
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The picture could not be written."))));
  });
}

/**
 * Pictures of files, without a viewer: for lists. All are drawn in the frame of the largest, so that sizes compare.
 * @param {{ buffer: ArrayBuffer, format?: import("./loading.js").Format }[]} files
 * @param {SnapshotOptions} options
 * @returns {Promise<Blob[]>} PNG
 */
export async function snapshotAssets(files, options = {}) {
  const renderer = acquireRenderer();
  const stage = new Stage();
  /** @type {import("three").Object3D[]} */
  const roots = [];
  try {
    for (const { buffer, format = "glb" } of files) roots.push(await parseAsset(buffer, format, renderer.gl));
    const box = new Box3();
    for (const root of roots) {
      dress(root, renderer.gl);
      box.union(boundsOf(root));
    }
    stage.scene.environment = renderer.environment.texture;
    stage.enclose(box);
    const camera = makeCamera();
    camera.aspect = (options.width ?? 512) / (options.height ?? 512);
    frameBox(camera, box, defaultDirection());
    const pictures = [];
    for (const root of roots) {
      stage.scene.add(root);
      stage.refreshShadow();
      pictures.push(await drawSnapshot(renderer, stage, camera, options));
      root.removeFromParent();
    }
    return pictures;
  } finally {
    roots.forEach(disposeAsset);
    stage.dispose();
    releaseRenderer();
  }
}
