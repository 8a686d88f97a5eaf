// A shape of which only the vertices are fetched, without a browser.
import assert from "node:assert/strict";
import { test } from "node:test";

import { verticesOf } from "../../service/web/viewer/blend-glb.js";
import { binaryChunk, readJson, writeGlb } from "../../service/web/viewer/glb.js";
import { movedGlb } from "../../service/web/viewer/moved.js";

const COUNT = 9000;

/** A GLB of as many triangles, with a picture of 400 kB between vertices and faces; `shift` moves the vertices. */
function scene(shift, { count = COUNT, interleaved = false, padding = 0, faces = 0, extra = {} } = {}) {
  const positions = Float32Array.from({ length: 3 * count }, (_, i) => Math.sin(i) + shift);
  const normals = Float32Array.from({ length: 3 * count }, (_, i) => Math.cos(i + shift));
  const picture = new Uint8Array(400_000).fill(7);
  const indices = Uint32Array.from({ length: 3 * count + faces }, (_, i) => i % count);
  const both = new Float32Array(6 * count);
  for (let v = 0; v < count; v++) both.set([...positions.subarray(3 * v, 3 * v + 3), ...normals.subarray(3 * v, 3 * v + 3)], 6 * v);
  const lists = interleaved ? [both, new Uint8Array(), picture, indices] : [positions, normals, picture, indices];
  const parts = [new Uint8Array(padding), ...lists.map((list) => new Uint8Array(list.buffer, list.byteOffset, list.byteLength))];
  let at = padding;
  const bufferViews = parts.slice(1).map(({ length }) => ({ buffer: 0, byteOffset: (at += length) - length, byteLength: length, ...(interleaved && length === 24 * count ? { byteStride: 24 } : {}) }));
  const json = {
    asset: { version: "2.0", extras: { note: "x".repeat(padding) } },
    scenes: [{ nodes: [0] }],
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0, NORMAL: 1 }, indices: 2 }] }],
    accessors: [
      { bufferView: 0, componentType: 5126, count, type: "VEC3", min: [shift - 1], max: [shift + 1] },
      { bufferView: interleaved ? 0 : 1, byteOffset: interleaved ? 12 : 0, componentType: 5126, count, type: "VEC3", ...extra },
      { bufferView: 3, componentType: 5125, count: indices.length, type: "SCALAR" },
    ],
    bufferViews,
    buffers: [{ byteLength: at }],
  };
  return writeGlb(json, parts);
}

/** What fetches parts of a file, and how many bytes it has fetched. */
function server(file) {
  const asked = { bytes: 0, requests: 0 };
  const fetchRange = async ({ start, end }) => {
    const bytes = new Uint8Array(file.slice(start, end));
    asked.bytes += bytes.length;
    asked.requests += 1;
    return { bytes, size: file.byteLength };
  };
  return { asked, fetchRange };
}

test("the source's file comes with the vertices of the shape, to the bit, for a part of its bytes", async () => {
  const shape = scene(5);
  const [wanted] = verticesOf(shape);
  for (const [form, padding] of [[{}, 0], [{}, 80_000], [{ interleaved: true }, 0]]) {
    const source = scene(0, form);
    const kept = source.slice(0);
    const far = scene(5, { padding });
    const { asked, fetchRange } = server(far);
    const moved = await movedGlb(source, fetchRange);
    const [found] = verticesOf(moved);
    assert.deepEqual(found, wanted);
    assert.deepEqual(readJson(moved).accessors[0].min, [4]);
    assert.ok(asked.bytes < 0.6 * far.byteLength, `${asked.bytes} of ${far.byteLength}`);
    assert.equal(asked.requests, padding ? 3 : 2);
    // All but the vertices is the source's.
    assert.deepEqual(binaryChunk(moved).subarray(24 * COUNT), binaryChunk(source).subarray(24 * COUNT));
    assert.deepEqual(new Uint8Array(source), new Uint8Array(kept));
  }
});

test("where the files do not fit, or little is saved, the file is fetched whole", async () => {
  const source = scene(0);
  for (const other of [scene(5, { count: COUNT + 3 }), scene(5, { faces: 3 }), scene(5, { extra: { componentType: 5122 } }), new ArrayBuffer(90_000)])
    assert.equal(await movedGlb(source, server(other).fetchRange), null);
  const packed = scene(5, { extra: { sparse: {} } });
  assert.equal(await movedGlb(source, server(packed).fetchRange), null);
  assert.equal(await movedGlb(new TextEncoder().encode("v 0 0 0").buffer, server(source).fetchRange), null);
  const bare = (shift) => {
    const whole = scene(shift);
    const json = readJson(whole);
    json.bufferViews[3].byteOffset -= 400_000;
    const chunk = binaryChunk(whole);
    return writeGlb(json, [chunk.slice(0, 24 * COUNT), chunk.slice(24 * COUNT + 400_000, 24 * COUNT + 400_000 + 4 * COUNT)]);
  };
  assert.equal(await movedGlb(bare(0), server(bare(5)).fetchRange), null);
  const broken = { fetchRange: async () => { throw new Error("The connection was lost."); } };
  await assert.rejects(movedGlb(source, broken.fetchRange), /connection/);
});
