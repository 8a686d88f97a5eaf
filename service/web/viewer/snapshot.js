// @ts-check
/** Pictures of meshes as PNG files, drawn by the shared renderer: a sheet of many needs no more than one context. */
import { defaultDirection, frameBox, makeCamera } from "./cameras.js";
import { disposeAsset, parseAsset } from "./loading.js";
import { acquireRenderer, releaseRenderer } from "./renderer.js";
import { boundsOf, dress, Stage } from "./stage.js";

/**
 * @typedef {{ width?: number, height?: number, background?: string, type?: string, quality?: number }} SnapshotOptions
 *   `background` is a CSS colour, `type` the media type of the picture
 */

/**
 * Draw a scene once.
 * @param {import("./renderer.js").SharedRenderer} renderer
 * @param {Stage} stage
 * @param {import("three").PerspectiveCamera} camera
 * @param {SnapshotOptions} options without a background the picture is transparent around the mesh
 * @returns {Promise<Blob>} PNG, also if the browser cannot write `type`
 */
export async function drawSnapshot(renderer, stage, camera, { width = 512, height = 512, background, type = "image/png", quality } = {}) {
  const limit = renderer.maxSize;
  if (!(width >= 1 && height >= 1 && width <= limit && height <= limit)) {
    throw new Error(`A picture can be 1 to ${limit} pixels wide and high, not ${width} × ${height}.`);
  }
  if (renderer.lost) throw new Error("The graphics card was lost for the moment; try again.");
  const canvas = document.createElement("canvas");
  canvas.width = Math.round(width);
  canvas.height = Math.round(height);
  const target = canvas.getContext("2d");
  if (!target) throw new Error("This browser has no 2D canvas.");
  const { aspect } = camera;
  camera.aspect = canvas.width / canvas.height;
  camera.updateProjectionMatrix();
  if (background) {
    target.fillStyle = background;
    target.fillRect(0, 0, canvas.width, canvas.height);
  }
  renderer.draw(stage, camera, target, canvas.width, canvas.height);
  camera.aspect = aspect;
  camera.updateProjectionMatrix();
  return new Promise((resolve, reject) => {
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The picture could not be written."))), type, quality);
  });
}

/**
 * A picture of a file, without a viewer: for lists and contact sheets.
 * @param {ArrayBuffer} buffer
 * @param {SnapshotOptions & { format?: import("./loading.js").Format, dark?: boolean }} options
 * @returns {Promise<Blob>} PNG
 */
export async function snapshotAsset(buffer, { format = "glb", dark = false, ...options } = {}) {
  const renderer = acquireRenderer();
  const stage = new Stage();
  try {
    const root = await parseAsset(buffer, format, renderer.gl);
    try {
      dress(root, renderer.gl);
      stage.scene.environment = renderer.environment.texture;
      stage.scene.add(root);
      stage.setTheme(dark);
      const box = boundsOf(root);
      stage.enclose(box);
      const camera = makeCamera();
      camera.aspect = (options.width ?? 512) / (options.height ?? 512);
      frameBox(camera, box, defaultDirection());
      return await drawSnapshot(renderer, stage, camera, options);
    } finally {
      disposeAsset(root);
    }
  } finally {
    stage.dispose();
    releaseRenderer();
  }
}
