// The viewer's colours, its camera's arithmetic and the GLB container, without a browser.
import assert from "node:assert/strict";
import { test } from "node:test";

import { COLORMAPS, colorAt, colorRow, formatValue, positionOf, ticks } from "../../service/web/viewer/colormaps.js";
import { Box3, Vector3 } from "../../service/web/vendor/three/three.module.js";
import { defaultDirection, frameBox, makeCamera } from "../../service/web/viewer/cameras.js";
import { isGlb, readJson, withJson, withoutMaterials } from "../../service/web/viewer/glb.js";

test("the maps have their published ends and middle", () => {
  assert.deepEqual(colorAt("viridis", 0), [0x44, 0x01, 0x54]);
  assert.deepEqual(colorAt("viridis", 0.5), [0x21, 0x91, 0x8c]);
  assert.deepEqual(colorAt("viridis", 1), [0xfd, 0xe7, 0x25]);
  assert.deepEqual(colorAt("plasma", -3), [0x0d, 0x08, 0x87]);
  assert.deepEqual(colorAt("plasma", 7), [0xf0, 0xf9, 0x21]);
});

test("the maps grow lighter all the way, so that they can be read without colour", () => {
  const linear = (value) => (value <= 10.31475 ? value / 3294.6 : ((value / 255 + 0.055) / 1.055) ** 2.4);
  for (const name of Object.keys(COLORMAPS)) {
    const row = colorRow(name, 64);
    let last = -1;
    for (let i = 0; i < row.length; i += 4) {
      const light = 0.2126 * linear(row[i]) + 0.7152 * linear(row[i + 1]) + 0.0722 * linear(row[i + 2]);
      assert.ok(light > last, `${name} at ${i / 4}`);
      last = light;
    }
  }
});

test("a legend names its ends and its middle", () => {
  const said = (range, scale) => ticks({ range, scale }).map(({ text, at }) => [text, at]);
  assert.deepEqual(said([0, 0.37], "linear"), [["0", 0], ["0.185", 0.5], ["0.37", 1]]);
  assert.deepEqual(said([1, 100], "log"), [["1", 0], ["10", 0.5], ["100", 1]]);
  assert.deepEqual(said([0, 0], "linear"), [["0", 0]]);
});

test("a logarithmic legend has factors at equal distances", () => {
  const legend = { range: [1, 16], scale: "log" };
  assert.deepEqual([1, 2, 4, 8, 16].map((value) => positionOf(value, legend)), [0, 0.25, 0.5, 0.75, 1]);
});

test("values are written without noise", () =>
  assert.deepEqual([0, 0.1 + 0.2, 1234.5678, 1e-5, 2e7].map(formatValue), ["0", "0.3", "1230", "1.0e-5", "2.0e+7"]));

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
