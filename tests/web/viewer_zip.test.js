import assert from "node:assert/strict";
import { test } from "node:test";
import { deflateRawSync } from "node:zlib";
import { binaryChunk, readJson, writeGlb } from "../../service/web/viewer/glb.js";
import { unpacked } from "../../service/web/viewer/zip.js";

/** A ZIP of these files, of which every other one is compressed. */
function zip(files) {
  const [locals, central] = [[], []];
  let at = 0;
  for (const [index, [name, data]] of Object.entries(files).entries()) {
    const raw = Buffer.from(data);
    const packed = index % 2 ? raw : deflateRawSync(raw);
    const head = Buffer.alloc(30);
    head.writeUInt32LE(0x04034b50, 0);
    head.writeUInt16LE(name.length, 26);
    locals.push(head, Buffer.from(name), packed);
    const entry = Buffer.alloc(46);
    entry.writeUInt32LE(0x02014b50, 0);
    entry.writeUInt16LE(index % 2 ? 0 : 8, 10);
    entry.writeUInt32LE(packed.length, 20);
    entry.writeUInt32LE(raw.length, 24);
    entry.writeUInt16LE(name.length, 28);
    entry.writeUInt32LE(at, 42);
    central.push(entry, Buffer.from(name));
    at += 30 + name.length + packed.length;
  }
  const end = Buffer.alloc(22);
  end.writeUInt32LE(0x06054b50, 0);
  end.writeUInt16LE(Object.keys(files).length, 10);
  end.writeUInt32LE(at, 16);
  return arrayBuffer(Buffer.concat([...locals, ...central, end]));
}

const arrayBuffer = (buffer) => new Uint8Array(buffer).buffer;
const GLTF = {
  buffers: [{ uri: "data/one.bin", byteLength: 3 }, { uri: "two%20b.bin", byteLength: 5 }, { uri: "data:application/octet-stream;base64,CQ==", byteLength: 1 }],
  bufferViews: [{ buffer: 1, byteOffset: 2, byteLength: 3 }, { buffer: 0, byteLength: 3 }, { buffer: 2, byteLength: 1 }],
  images: [{ uri: "Skin.PNG" }, { uri: "missing.png" }],
};

test("a glTF in a ZIP becomes a GLB with its buffers and images", async () => {
  const files = { "model/a.gltf": JSON.stringify(GLTF), "model/data/one.bin": [1, 2, 3], "model/two b.bin": [4, 5, 6, 7, 8], "model/skin.png": [137, 80], "notes.txt": "x" };
  const { buffer, format } = await unpacked(zip(files), "zip");
  assert.equal(format, "glb");
  const json = readJson(buffer);
  const binary = binaryChunk(buffer);
  const seen = json.bufferViews.map(({ buffer: index, byteOffset, byteLength }) => {
    assert.equal(index, 0);
    return [...binary.subarray(byteOffset, byteOffset + byteLength)];
  });
  assert.deepEqual(seen.slice(0, 4), [[6, 7, 8], [1, 2, 3], [9], [137, 80]]);
  assert.deepEqual(json.images.map(({ uri, mimeType, bufferView }) => [uri, mimeType, bufferView]), [[undefined, "image/png", 3], [undefined, "image/png", 4]]);
  assert.deepEqual(seen[4].slice(1, 4), [...Buffer.from("PNG")]);
  assert.equal(json.buffers[0].byteLength, binary.length);
});

test("other assets come as they are, and a GLB's missing images are white", async () => {
  assert.deepEqual(await unpacked(zip({ "a.mtl": "m", "b/a.obj": "v 0 0 0" }), "zip"), { buffer: arrayBuffer(Buffer.from("v 0 0 0")), format: "obj" });
  const glb = writeGlb({ buffers: [{ byteLength: 4 }], bufferViews: [{ buffer: 0, byteLength: 4 }], images: [{ uri: "Textures/colormap.png" }] }, [Uint8Array.of(1, 2, 3, 4)]);
  const { buffer } = await unpacked(glb, "glb");
  assert.deepEqual([...binaryChunk(buffer).subarray(0, 4)], [1, 2, 3, 4]);
  assert.equal(readJson(buffer).images[0].bufferView, 1);
  const plain = writeGlb({ buffers: [] }, []);
  assert.equal((await unpacked(plain, "glb")).buffer, plain);
});

test("what is wrong with a ZIP is said", async () => {
  const wrong = [
    [zip({ "readme.txt": "x" }), /no GLB, glTF, OBJ, PLY or STL/],
    [zip({ "a.obj": "x", "b.obj": "y" }), /several assets: a.obj, b.obj/],
    [zip({ "a.gltf": JSON.stringify(GLTF) }), /lacks data\/one.bin/],
    [zip({ "a.obj": "v 0 0 0" }).slice(0, 60), /cut off or damaged/],
  ];
  for (const [file, message] of wrong) await assert.rejects(unpacked(file, "zip"), message);
});
