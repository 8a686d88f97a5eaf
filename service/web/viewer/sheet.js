// @ts-check
/** One picture of many shapes in rows and columns, all seen from the same side and at the same scale. */
import { Box3 } from "../vendor/three/three.module.js";
import { defaultDirection, frameBox, makeCamera } from "./cameras.js";
import { withoutMaterials } from "./glb.js";
import { disposeAsset, parseAsset } from "./loading.js";
import { acquireRenderer, releaseRenderer } from "./renderer.js";
import { drawSnapshot } from "./snapshot.js";
import { boundsOf, dress, Stage } from "./stage.js";

/** @typedef {{ label: string, shapes: (ArrayBuffer | null)[] }} SheetRow GLBs; null leaves the cell empty */
/** @typedef {{ cell?: number, background: string, ink: string, font: string, dark?: boolean, signal?: AbortSignal }} SheetOptions */

const MARGIN = 0.28; // of a cell, for the labels at the top and on the left
const MOST_PIXELS = 8192;

/**
 * Draw the shapes.
 * @param {string[]} columns what stands above each
 * @param {SheetRow[]} rows
 * @param {SheetOptions} options `cell` is the width of one in pixels; colours and the font are those of CSS
 * @returns {Promise<Blob>} PNG
 */
export async function drawSheet(columns, rows, { cell = 320, background, ink, font, dark = false, signal }) {
  const size = Math.floor(Math.min(cell, MOST_PIXELS / (columns.length + MARGIN), MOST_PIXELS / (rows.length + MARGIN)));
  const edge = Math.round(MARGIN * size);
  const canvas = document.createElement("canvas");
  canvas.width = edge + columns.length * size;
  canvas.height = edge + rows.length * size;
  const context = canvas.getContext("2d");
  if (!context) throw new Error("This browser has no 2D canvas.");
  context.fillStyle = background;
  context.fillRect(0, 0, canvas.width, canvas.height);
  const renderer = acquireRenderer();
  const stage = new Stage();
  try {
    const shapes = rows.flatMap((row) => row.shapes).filter((shape) => shape !== null);
    const box = new Box3();
    for (const shape of shapes) box.union(await boxOf(shape, renderer));
    stage.setTheme(dark);
    stage.scene.environment = renderer.environment.texture;
    const camera = makeCamera();
    frameBox(camera, box, defaultDirection());
    for (const [y, row] of rows.entries()) {
      for (const [x, shape] of row.shapes.entries()) {
        if (!shape) continue;
        signal?.throwIfAborted();
        const root = await parseAsset(shape.slice(0), "glb", renderer.gl);
        dress(root, renderer.gl);
        stage.scene.add(root);
        stage.enclose(boundsOf(root));
        const picture = await createImageBitmap(await drawSnapshot(renderer, stage, camera, { width: size, height: size }));
        context.drawImage(picture, edge + x * size, edge + y * size);
        picture.close();
        root.removeFromParent();
        disposeAsset(root);
      }
    }
    context.fillStyle = ink;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.font = `500 ${Math.round(0.3 * edge)}px ${font}`;
    columns.forEach((text, x) => context.fillText(text, edge + (x + 0.5) * size, edge / 2, size));
    rows.forEach(({ label }, y) => {
      context.save();
      context.translate(edge / 2, edge + (y + 0.5) * size);
      context.rotate(-Math.PI / 2);
      context.fillText(label, 0, 0, size);
      context.restore();
    });
    return await new Promise((resolve, reject) => canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The picture could not be written.")))));
  } finally {
    stage.dispose();
    releaseRenderer();
  }
}

/** @param {ArrayBuffer} shape @param {import("./renderer.js").SharedRenderer} renderer @returns {Promise<Box3>} */
async function boxOf(shape, renderer) {
  const root = await parseAsset(withoutMaterials(shape), "glb", renderer.gl);
  const box = boundsOf(root);
  disposeAsset(root);
  return box;
}
