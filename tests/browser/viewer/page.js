// Opens viewers for the tests, which drive them through `window`.
import { acquireRenderer, contextCount, releaseRenderer, SharedRenderer } from "/web/viewer/renderer.js";
import { ControlTools } from "/web/viewer/control/tools.js";
import { numberedSurface } from "/web/viewer/control/surface.js";
import { snapshotAssets } from "/web/viewer/snapshot.js";
import { linkCameras, MeshViewer } from "/web/viewer/viewer.js";

const stage = document.getElementById("stage");

/** @param {string} path */
async function fetchBytes(path) {
  const response = await fetch(path);
  if (!response.ok) throw new Error(`${path}: ${response.status}`);
  return response.arrayBuffer();
}

/** Two frames: what was asked for before has been drawn. */
async function drawn() {
  for (let i = 0; i < 2; i++) await new Promise((resolve) => requestAnimationFrame(resolve));
}

/** @param {MeshViewer} viewer @returns {ImageData} */
function pixels({ surface: { context, canvas } }) {
  return context.getImageData(0, 0, canvas.width, canvas.height);
}

/** @param {string} label */
function open(label) {
  const container = document.createElement("div");
  container.className = "viewer";
  stage.append(container);
  const viewer = new MeshViewer(container, { label });
  opened.push(viewer);
  return viewer;
}

/** Pixels of the mesh: those that are opaque; the ground's shadow is not. @param {ImageData} image */
function covered({ data }) {
  let count = 0;
  for (let i = 3; i < data.length; i += 4) if (data[i] > 250) count++;
  return count;
}

/** Pixels that differ clearly. @param {ImageData} a @param {ImageData} b */
function difference(a, b) {
  let count = 0;
  for (let i = 0; i < a.data.length; i += 4) {
    let most = 0;
    for (let c = 0; c < 4; c++) most = Math.max(most, Math.abs(a.data[i + c] - b.data[i + c]));
    if (most > 24) count++;
  }
  return count;
}

/** The mesh that is shown, not the ground. @param {MeshViewer} viewer */
function meshOf(viewer) {
  let found = null;
  viewer.stage.scene.traverse((object) => {
    if (object.isMesh && object.castShadow) found ??= object;
  });
  return found;
}

/** The farthest that a vertex goes from the source to the result, in the world. @param {MeshViewer} viewer */
function farthest(viewer) {
  const places = [0, 1].map((t) => {
    viewer.setMorph(t);
    viewer.root.updateMatrixWorld(true);
    const found = [];
    const point = viewer.rig.camera.position.clone();
    viewer.root.traverse((object) => {
      const count = object.isMesh && object.castShadow ? object.geometry.attributes.position.count : 0;
      for (let v = 0; v < count; v++) found.push(...object.getVertexPosition(v, point).applyMatrix4(object.matrixWorld).toArray());
    });
    return found;
  });
  const [before, after] = places;
  let most = 0;
  for (let i = 0; i < before.length; i += 3) most = Math.max(most, Math.hypot(after[i] - before[i], after[i + 1] - before[i + 1], after[i + 2] - before[i + 2]));
  return most;
}

/** Close all viewers. */
function closeAll() {
  for (const viewer of opened.splice(0)) viewer.dispose();
  stage.replaceChildren();
}

/** @type {MeshViewer[]} */
const opened = [];

/**
 * A viewer with a file in it, and with its result if that is named.
 * @param {string} name @param {string} format @param {string | null} result
 */
async function show(name, format = "glb", result = null) {
  const viewer = open(name);
  viewer.facts = await viewer.load(await fetchBytes(`/files/${name}`), { format });
  if (result) await viewer.setDeformed(await fetchBytes(`/files/${result}`));
  await drawn();
  return viewer;
}

/** What a promise rejects with. @param {Promise<unknown>} promise */
async function failure(promise) {
  try {
    await promise;
    return null;
  } catch (error) {
    return { name: error.name, code: error.code ?? null, message: error.message };
  }
}

Object.assign(window, {
  acquireRenderer, ControlTools, closeAll, failure, farthest, meshOf, releaseRenderer, SharedRenderer, show,
  contextCount, covered, difference, drawn, fetchBytes, linkCameras, numberedSurface, open, pixels, snapshotAssets, ready: true,
});
