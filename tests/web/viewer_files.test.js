// The arithmetic of the viewer's camera and the GLB container, without a browser.
import assert from "node:assert/strict";
import { test } from "node:test";

import { Box3, Vector3 } from "../../service/web/vendor/three/three.module.js";
import { defaultDirection, frameBox, makeCamera } from "../../service/web/viewer/cameras.js";
import { isGlb, readJson, withJson, withoutMaterials } from "../../service/web/viewer/glb.js";

test("a box fills the picture and no corner is outside", () => {
  for (const [aspect, size] of [[0.5, 1], [1, 1e-5], [2.3, 1e5]]) {
    const camera = Object.assign(makeCamera(), { aspect });
    const box = new Box3(new Vector3(-1, 0, 2).multiplyScalar(size), new Vector3(1, 4, 2.6).multiplyScalar(size));
    frameBox(camera, box, defaultDirection());
    camera.updateMatrixWorld();
    const corners = Array.from({ length: 8 }, (_, bits) => new Vector3(...["x", "y", "z"].map((axis, i) => (bits & (1 << i) ? box.max : box.min)[axis])));
    const seen = corners.map((corner) => corner.project(camera));
    const most = Math.max(...seen.flatMap(({ x, y }) => [Math.abs(x), Math.abs(y)]));
    assert.ok(Math.abs(most - 1 / 1.04) < 1e-6, `${most}`);
    assert.ok(seen.every(({ z }) => Math.abs(z) < 1));
  }
});

/** A GLB of a JSON and four bytes. */
function glb(json) {
  return withJson(new Uint8Array([...header(), 0x7b, 0x7d, 0x20, 0x20, 4, 0, 0, 0, 0x42, 0x49, 0x4e, 0, 1, 2, 3, 4]).buffer, json);
}

/** The header of a GLB with a JSON chunk of four bytes. */
function header() {
  const view = new DataView(new ArrayBuffer(20));
  [0x46546c67, 2, 36, 4, 0x4e4f534a].forEach((word, i) => view.setUint32(4 * i, word, true));
  return new Uint8Array(view.buffer);
}

test("a GLB keeps its other chunks when its JSON is replaced", () => {
  const file = glb({ asset: { version: "2.0" }, name: "ä" });
  assert.ok(isGlb(file));
  assert.equal(file.byteLength % 4, 0);
  assert.equal(new DataView(file).getUint32(8, true), file.byteLength);
  assert.equal(readJson(file).name, "ä");
  assert.deepEqual([...new Uint8Array(file).slice(-12)], [4, 0, 0, 0, 0x42, 0x49, 0x4e, 0, 1, 2, 3, 4]);
});

test("a result is read without its materials", () => {
  const primitive = { attributes: { POSITION: 0 }, material: 0, extensions: { KHR_materials_variants: {}, X: 1 } };
  const file = glb({ materials: [{}], textures: [{}], images: [{}], meshes: [{ primitives: [primitive] }], nodes: [{}] });
  const { meshes, nodes, ...rest } = readJson(withoutMaterials(file));
  assert.deepEqual(meshes, [{ primitives: [{ attributes: { POSITION: 0 }, extensions: { X: 1 } }] }]);
  assert.deepEqual([nodes, rest], [[{}], {}]);
});

test("what is no glTF is told", () => {
  assert.throws(() => readJson(new TextEncoder().encode("solid cube").buffer), /not a glTF file/);
  const damaged = glb({});
  new DataView(damaged).setUint32(12, 1e6, true);
  assert.throws(() => readJson(damaged), /damaged/);
});
