import assert from "node:assert/strict";
import { test } from "node:test";
import { lessonFindings } from "../../service/web/app/job/results.js";
import { parseRoute, routeHash } from "../../service/web/app/router.js";
import { crc32, namesInZip, packMeshes } from "../../service/web/client/meshes.js";
import { assetIn } from "../../service/web/viewer/zip.js";

test("the checksum is that of the ZIP format", () => {
  assert.equal(crc32(new TextEncoder().encode("123456789")), 0xcbf43926);
  assert.equal(crc32(new Uint8Array()), 0);
});

test("what is packed is found again, and the same files are the same ZIP", async () => {
  const bytes = new TextEncoder().encode("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  const files = [{ file: new File([bytes], "can.obj"), label: "tall" }, new File([new Uint8Array([1])], "notes – é.txt")];
  const zip = await (await packMeshes(files)).arrayBuffer();
  assert.deepEqual(zip, await (await packMeshes(files)).arrayBuffer());
  const found = assetIn(zip);
  assert.equal(found.format, "obj");
  assert.deepEqual(new Uint8Array(found.buffer), bytes);
});

test("files of one name get different ones, and labels become folders", () => {
  const files = [{ name: "a.glb", label: "" }, { name: "A.glb", label: "" }, { name: "a.glb", label: "tall" }, { name: "x/y\\a.glb", label: "tall" }];
  assert.deepEqual(namesInZip(files), ["a.glb", "A-2.glb", "tall/a.glb", "tall/a-2.glb"]);
});

test("a lesson that went wrong is said to have", () => {
  const share = (hits, pictures) => ({ hits, pictures, share: hits / pictures });
  const report = (learned, after) => ({
    nouns: [{ noun: "owl" }],
    retrieval: { new: share(learned, 12), old_before: share(40, 40), old_after: share(after, 40) },
    steps: { done: 600, best: 550, most: 600 },
    stopped_early: false,
    warnings: ["Turn it."],
  });
  assert.deepEqual(lessonFindings(report(11, 38)).map(({ tone }) => tone), ["good", "good", "plain", "warn"]);
  assert.deepEqual(lessonFindings(report(3, 20)).map(({ tone }) => tone), ["warn", "warn", "plain", "warn"]);
  assert.match(lessonFindings(report(3, 20))[0].text, /^3 of 12 .* an owl/);
});

test("the address of a taught word leads to it, and no other model is taken from an address", () => {
  const model = "job:job_01kg9zqk2xf3v8c5m7n9p1r4t6";
  const route = { name: "create", from: null, model, prompt: "a tea pot" };
  assert.deepEqual(parseRoute(routeHash(route)), route);
  assert.deepEqual(parseRoute("#/?model=other/model&prompt=x"), { name: "create", from: null });
  assert.deepEqual(parseRoute("#/teach"), { name: "teach" });
  assert.equal(routeHash({ name: "teach" }), "#/teach");
});
