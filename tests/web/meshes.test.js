import assert from "node:assert/strict";
import { test } from "node:test";
import { crc32, namesInZip, packMeshes } from "../../service/web/client/meshes.js";
import { assetIn } from "../../service/web/viewer/zip.js";

test("the checksum is that of the ZIP format", () => {
  assert.equal(crc32(new TextEncoder().encode("123456789")), 0xcbf43926);
  assert.equal(crc32(new Uint8Array()), 0);
});

test("what is packed is found again, and the same files are the same ZIP", async () => {
  const bytes = new TextEncoder().encode("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  const files = [new File([bytes], "can.obj"), new File([new Uint8Array([1])], "notes – é.txt")];
  const zip = await (await packMeshes(files)).arrayBuffer();
  assert.deepEqual(zip, await (await packMeshes(files)).arrayBuffer());
  const found = assetIn(zip);
  assert.equal(found.format, "obj");
  assert.deepEqual(new Uint8Array(found.buffer), bytes);
});

test("files of one name get different ones", () => {
  assert.deepEqual(namesInZip(["a.glb", "A.glb", "x/y\\a.glb", "b.glb"]), ["a.glb", "A-2.glb", "a-3.glb", "b.glb"]);
});
