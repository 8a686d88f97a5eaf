import assert from "node:assert/strict";
import { test } from "node:test";
import { findings, shapeWords } from "../../service/web/app/quality.js";
import { wishOf } from "../../service/web/app/params.js";
import { learnNames, plainWords } from "../../service/web/app/plain.js";
import { isWorthLess } from "../../service/web/app/verdict.js";
import { artifactName, shapeName } from "../../service/web/app/names.js";
import { catalogue, ownNouns } from "../../service/web/app/vocabulary.js";

test("good news, bad news and no news of a mesh", () => {
  const good = findings({ quality: { flipped_faces: 0, self_intersecting_faces_before: 0, self_intersecting_faces_after: 0 } });
  assert.deepEqual(good.map((found) => [found.tone, found.text]), [["good", "No flipped faces"], ["good", "No self-intersections"]]);
  const bad = findings({ quality: { flipped_faces: 12, self_intersecting_faces_before: 0, self_intersecting_faces_after: 3 } });
  assert.deepEqual(bad.map((found) => [found.tone, found.text]), [
    ["warn", "12 flipped faces"], ["warn", "3 self-intersecting faces"],
  ]);
  assert.equal(findings({ quality: { self_intersecting_faces_before: 3, self_intersecting_faces_after: 3 } })[0].tone, "plain");
  const quality = { self_intersecting_faces_before: 3, self_intersecting_faces_after: 3, self_intersections_added: 2 };
  assert.equal(findings({ quality })[0].tone, "warn");
  const [about] = findings({ input: { warnings: ["2 normals were rebuilt."] } });
  assert.deepEqual([about.tone, about.text, about.note], ["plain", "About your file", "2 normals were rebuilt."]);
  assert.deepEqual(findings({}), []);
  assert.deepEqual(findings(null), []);
});

const said = (/** @type {any} */ report) => findings(report).map(({ tone, text }) => [tone, text]);

test("of a bad result nothing is marked as good", () => {
  const reasons = ["It looks no more like a bus than before: rank 5 of 122 nouns, was 5.", "Faces were flipped: 2."];
  const report = {
    verdict: { value: "keep_source", reasons, advice: ["Try “a van”."] },
    quality: { flipped_faces: 0 },
    posed_quality: { flipped_faces: 2, self_intersecting_faces_after: 0 },
    warnings: ["Damaged faces in the pose that viewers show, of 80: 2 flipped.", "Damaged faces in the bind pose, of 80: 1 flipped."],
    mesh: { welded_faces: 80, same_faces: true },
  };
  assert.deepEqual(said(report), [
    ["warn", "2 flipped faces"], ["plain", "No self-intersections"], ["plain", "Same triangles as before"],
  ]);
});

test("a good and a doubtful result", () => {
  const quality = { flipped_faces: 0 };
  assert.deepEqual(said({ verdict: { value: "good", reasons: ["It looks like a bus."], advice: [] }, quality }), [["good", "No flipped faces"]]);
  assert.deepEqual(said({ verdict: { value: "doubtful", reasons: ["It does not look like a bus."], advice: [] }, quality }), [["plain", "No flipped faces"]]);
  assert.deepEqual(said({ quality }), [["good", "No flipped faces"]]);
  assert.deepEqual([isWorthLess({}), isWorthLess({ verdict: { value: "good" } }), isWorthLess({ verdict: { value: "of later versions" } })], [false, false, true]);
});

test("how well a target is met, and the source of a surface fit", () => {
  assert.deepEqual(said({ fit: { within: 0.991 } }), [["good", "Fits the target: 99%"]]);
  assert.deepEqual(said({ fit: { within: 0.72 } }), [["plain", "Fits the target: 72%"]]);
  assert.deepEqual(said({ levels: [{ distance: { mean: 0.02 } }, { distance: { mean: 0.0012 } }] }), [["plain", "Distance from your file 0.12%"]]);
});

test("a shape of a family whose parts hang apart is not only praised", () => {
  const parts = [{ gap: 0.002 }, { gap: 0.0449 }];
  assert.equal(shapeWords({ nearest_members: [{ name: "chair.glb", distance: 0.1 }], loose: [], parts: [parts[0]] }), "most like chair.glb");
  assert.equal(shapeWords({ nearest_members: [{ name: "chair.glb", distance: 0.1 }], loose: ["arm"], parts }), "loose: arm; parts up to 4% apart; most like chair.glb");
});

test("what a result looks like, and whether that was asked for", () => {
  const judged = { noun: "rabbit", probability: 0.834, next: { noun: "octopus", probability: 0.06 }, matches: true };
  assert.deepEqual(said({ likeness: judged }), [["good", "Looks like: a rabbit 83%"]]);
  const missed = { noun: "rabbit", probability: 0.12, matches: false, next: { noun: "octopus", probability: 0.62 } };
  assert.deepEqual(said({ likeness: missed }), [["warn", "Looks more like an octopus 62% than a rabbit 12%"]]);
  assert.deepEqual(findings({ likeness: null }), []);
  assert.deepEqual(said({ texture_stretch: { p50: 1, p95: 2.5, above_2: 0.1 } }), [["warn", "Texture stretched 2.5×"]]);
  assert.deepEqual(findings({ texture_stretch: null }), []);
  assert.deepEqual(said({ warnings: ["The mesh hardly moved."] }), [["warn", "The mesh hardly moved."]]);
});

test("files are named after what is in them", () => {
  const job = { asset: { filename: "Duck (2).glb" }, prompt: "a tall vase!", params: { seed: 7 } };
  assert.equal(artifactName(job, "result.glb"), "duck-2-a-tall-vase-seed7.glb");
  assert.equal(artifactName(job, "report.json"), "duck-2-a-tall-vase-seed7-report.json");
  assert.equal(shapeName(job, "step120", 100), "duck-2-a-tall-vase-seed7-step120.glb");
  assert.equal(shapeName(job, "", 50), "duck-2-a-tall-vase-seed7-strength50.glb");
  assert.equal(artifactName({ asset: { filename: ".obj" }, prompt: "" }, "result.glb"), "asset-target-seed0.glb");
});

test("models are as the server names them, and none where it could not be asked", () => {
  assert.deepEqual(catalogue({}), { default: "", models: [], shapes: null });
  const found = catalogue({ default: "builtin", models: [{ id: "builtin", vocabulary: { nouns: ["cat", "vase"], groups: { animals: ["cat"], vessels: ["vase"] } } }, { id: "sd", available: null, vocabulary: null }, { id: "away", available: false, vocabulary: null }] });
  assert.equal(found.default, "builtin");
  assert.deepEqual(found.models[0].vocabulary?.groups, [["animals", ["cat"]], ["vessels", ["vase"]]]);
  assert.equal(found.models[1].vocabulary, null);
  assert.deepEqual(found.models.map(({ available }) => available), [true, true, false]);
});

test("words of the user's own come first", () => {
  const { shapes } = catalogue({ models: [], default: "builtin", shapes: { nouns: ["vase-stand", "vase"], groups: { yours: ["vase-stand"], things: ["vase"] } } });
  assert.deepEqual(ownNouns(shapes), ["vase-stand"]);
  assert.deepEqual(ownNouns({ groups: [] }), []);
  assert.equal(catalogue({}).shapes, null);
});

test("a job that is asked for again has words as they are then, not as they were", () => {
  const params = { guidance: { kind: "exemplar", words: { fruit: "0".repeat(64) } }, seed: 1 };
  const job = { prompt: "a fruit", params, output: {}, files: { asset: {}, words: {} } };
  assert.equal("words" in wishOf(job).kept.params, false);
});

test("what only programs name is left out of sentences, and learnt from the schema", () => {
  learnNames({ properties: { seed: {}, max_run_s: {} }, $defs: { sds: { properties: { guidance_scale: {} } } } });
  assert.equal(plainWords("No part called legs. The asset has others; `parts` lists those."), "No part called legs.");
  assert.equal(plainWords("It took too long. Ask for a larger max_run_s, or set MESHDEFORM_MAX_RUN_S."), "It took too long.");
  assert.equal(plainWords("Set output.rig to follow."), "");
  assert.equal(plainWords("my_chair_v2.glb isn't supported."), "my_chair_v2.glb isn't supported.");
});
