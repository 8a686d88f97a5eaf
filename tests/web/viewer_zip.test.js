import assert from "node:assert/strict";
import { test } from "node:test";
import { zipSync } from "../../service/web/vendor/three/addons/libs/fflate.module.js";
import { assetIn } from "../../service/web/viewer/zip.js";

/** A ZIP of these files, of which every other one is compressed. */
function zip(files) {
  const entries = Object.entries(files).map(([name, data], index) => [name, [Uint8Array.from(Buffer.from(data)), { level: index % 2 ? 0 : 6 }]]);
  return zipSync(Object.fromEntries(entries)).buffer;
}

const text = (bytes) => new TextDecoder().decode(bytes);

test("the asset of a ZIP comes with the files that it refers to", () => {
  const files = { "model/a.gltf": "{}", "model/data/one.bin": [1, 2, 3], "model/two b.bin": [4, 5], "model/skin.png": [137, 80], "notes.txt": "x" };
  const { buffer, format, linked } = assetIn(zip(files));
  assert.deepEqual([text(buffer), format], ["{}", "gltf"]);
  const found = ["data/one.bin", "./two%20b.bin", "Skin.PNG", "..\\notes.txt", "missing.png"].map((uri) => linked(uri) && [...linked(uri)]);
  assert.deepEqual(found, [[1, 2, 3], [4, 5], [137, 80], [...Buffer.from("x")], undefined]);
  const plain = assetIn(zip({ "a.mtl": "m", "b/a.obj": "v 0 0 0", "__MACOSX/b.obj": "" }));
  assert.deepEqual([text(plain.buffer), plain.format], ["v 0 0 0", "obj"]);
});

test("what is wrong with a ZIP is said", () => {
  const wrong = [
    [zip({ "readme.txt": "x" }), /no GLB, glTF, OBJ, PLY or STL/],
    [zip({ "a.obj": "x", "b.obj": "y" }), /several assets: a.obj, b.obj/],
    [zip({ "a.obj": "v 0 0 0" }).slice(0, 60), /cut off or damaged/],
  ];
  for (const [file, message] of wrong) assert.throws(() => assetIn(file), message);
});
