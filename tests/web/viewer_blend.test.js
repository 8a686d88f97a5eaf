// A GLB between a source and its result, without a browser.
import assert from "node:assert/strict";
import { test } from "node:test";

import { blendGlb, verticesOf } from "../../service/web/viewer/blend-glb.js";
import { readJson } from "../../service/web/viewer/glb.js";

/** A GLB of one triangle with a name; `positions` as floats or as normalized 16-bit integers. */
function triangle(positions, normals, quantized = false) {
  const plain = quantized ? Int16Array.from(positions, (value) => Math.round(value * 32767)) : Float32Array.from(positions);
  const bytes = new Uint8Array([...new Uint8Array(plain.buffer), ...new Uint8Array(quantized ? 2 : 0), ...new Uint8Array(Float32Array.from(normals).buffer)]);
  const start = bytes.length - 36;
  const json = {
    asset: { version: "2.0" },
    scenes: [{ nodes: [0] }],
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0, NORMAL: 1 } }] }],
    accessors: [
      { bufferView: 0, componentType: quantized ? 5122 : 5126, normalized: quantized, count: 3, type: "VEC3", min: [9], max: [9] },
      { bufferView: 1, componentType: 5126, count: 3, type: "VEC3" },
    ],
    bufferViews: [{ buffer: 0, byteLength: plain.byteLength }, { buffer: 0, byteOffset: start, byteLength: 36 }],
    buffers: [{ byteLength: bytes.length }],
  };
  const text = new TextEncoder().encode(JSON.stringify(json));
  const padded = text.length + ((4 - (text.length % 4)) % 4);
  const out = new Uint8Array(28 + padded + bytes.length).fill(0x20, 20, 20 + padded);
  const view = new DataView(out.buffer);
  [0x46546c67, 2, out.length, padded, 0x4e4f534a].forEach((word, i) => view.setUint32(4 * i, word, true));
  out.set(text, 20);
  view.setUint32(20 + padded, bytes.length, true);
  view.setUint32(24 + padded, 0x004e4942, true);
  out.set(bytes, 28 + padded);
  return out.buffer;
}

const UP = [0, 0, 1, 0, 0, 1, 0, 0, 1];
const SIDE = [1, 0, 0, 1, 0, 0, 1, 0, 0];
const BEFORE = [0, 0, 0, 1, 0, 0, 0, 1, 0];
const AFTER = [0, 0, 2, 3, 0, 2, 0, 1, 2];

test("half the way is half the way, in positions, bounds and normals", () => {
  const result = triangle(AFTER, SIDE);
  const kept = result.slice(0);
  const half = blendGlb(result, verticesOf(triangle(BEFORE, UP)), 0.5);
  const [{ POSITION, NORMAL }] = verticesOf(half);
  assert.deepEqual([...POSITION], [0, 0, 1, 2, 0, 1, 0, 1, 1]);
  assert.deepEqual([...NORMAL].map((value) => value.toFixed(4)), Array(3).fill(["0.7071", "0.0000", "0.7071"]).flat());
  assert.deepEqual(readJson(half).accessors[0].min, [0, 0, 1]);
  assert.deepEqual(readJson(half).accessors[0].max, [2, 1, 1]);
  assert.deepEqual(new Uint8Array(result), new Uint8Array(kept));
});

test("both ends are the files' own, and a quantized source is read", () => {
  for (const quantized of [false, true]) {
    const source = verticesOf(triangle(BEFORE, UP, quantized));
    assert.deepEqual([...verticesOf(blendGlb(triangle(AFTER, SIDE), source, 0))[0].POSITION], BEFORE);
    assert.deepEqual([...verticesOf(blendGlb(triangle(AFTER, SIDE), source, 1))[0].POSITION], AFTER);
  }
  // Quantized results are written as they were: to the nearest of their numbers, with bounds in these.
  const down = blendGlb(triangle(BEFORE, UP, true), verticesOf(triangle(UP, UP, true)), 0.5);
  assert.deepEqual([...verticesOf(down)[0].POSITION].map((value) => Math.round(value * 1000)), [0, 0, 500, 500, 0, 500, 0, 500, 500]);
  assert.deepEqual(readJson(down).accessors[0].max, [16384, 16384, 16384]);
});

test("what does not fit is refused in words", () => {
  assert.throws(() => blendGlb(triangle(AFTER, SIDE), [], 0.5), /other meshes/);
  assert.throws(() => blendGlb(triangle(AFTER, SIDE), [{ POSITION: Float32Array.of(1, 2, 3) }], 0.5), /other vertices/);
});
