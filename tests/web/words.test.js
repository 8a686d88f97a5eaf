import assert from "node:assert/strict";
import { test } from "node:test";
import { findings, shapeWords, skipped } from "../../service/web/app/quality.js";
import { wishOf } from "../../service/web/app/params.js";
import { learnNames, plainWords } from "../../service/web/app/plain.js";
import { isWorthLess } from "../../service/web/app/verdict.js";
import { artifactName, shapeName } from "../../service/web/app/names.js";
import { adjectives, catalogue, nounIn, ownNouns, surprise, withAdjective, withNoun } from "../../service/web/app/vocabulary.js";

const KNOWN = { nouns: ["giraffe", "octopus", "vase"], parts: {}, attributes: ["tall", "thin", "long", "short/long neck"], examples: [], groups: [] };

test("good news, bad news and no news of a mesh", () => {
  const good = findings({ quality: { flipped_faces: 0, self_intersecting_faces_before: 0, self_intersecting_faces_after: 0 } });
  assert.deepEqual(good.map((found) => [found.tone, found.text]), [["good", "No flipped faces"], ["good", "No self-intersections"]]);
  const bad = findings({ mesh: { welded_faces: 5120 }, quality: { flipped_faces: 12, collapsed_faces: 1, self_intersecting_faces_before: 0, self_intersecting_faces_after: 3 } });
  assert.deepEqual(bad.map((found) => [found.tone, found.text]), [
    ["warn", "12 flipped faces of 5,120"], ["warn", "3 self-intersecting faces"], ["warn", "1 collapsed face of 5,120"],
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

test("of a bad result nothing is marked as good, and it is not called yours", () => {
  const reasons = ["It looks no more like a bus than before: rank 5 of 122 nouns, was 5.", "Faces were flipped: 2."];
  const report = {
    verdict: { value: "keep_source", reasons, advice: ["Try “a van”."] },
    quality: { kept_share: 0.4, flipped_faces: 0 },
    posed_quality: { kept_share: 0.92, flipped_faces: 2, self_intersecting_faces_after: 0 },
    warnings: ["Damaged faces in the pose that viewers show, of 80: 2 flipped.", "Damaged faces in the bind pose, of 80: 1 flipped."],
    mesh: { welded_faces: 80, same_faces: true },
  };
  assert.deepEqual(said(report), [
    ["warn", "2 flipped faces of 80"], ["plain", "No self-intersections"], ["plain", "Same triangles as before"],
  ]);
});

test("a good and a doubtful result", () => {
  const quality = { kept_share: 0.92, flipped_faces: 0 };
  assert.deepEqual(said({ verdict: { value: "good", reasons: ["It looks like a bus."], advice: [] }, quality }), [
    ["plain", "Still your asset: 92%"], ["good", "No flipped faces"],
  ]);
  assert.deepEqual(said({ verdict: { value: "doubtful", reasons: ["It does not look like a bus."], advice: [] }, quality }), [["plain", "No flipped faces"]]);
  assert.deepEqual(said({ quality }), [["plain", "Still your asset: 92%"], ["good", "No flipped faces"]]);
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
  const judged = { noun: "rabbit", probability: 0.834, nouns: 122, next: { noun: "octopus", probability: 0.06 }, matches: true };
  const [good] = findings({ likeness: judged });
  assert.deepEqual([good.tone, good.text], ["good", "Looks like: a rabbit 83%; next: an octopus 6%"]);
  assert.equal(good.note, "As the prompt says, judged from pictures. The judge knows 122 nouns.");
  const missed = { noun: "rabbit", probability: 0.12, matches: false, next: { noun: "octopus", probability: 0.62 } };
  const [bad] = findings({ likeness: missed });
  assert.deepEqual([bad.tone, bad.text], ["warn", "Looks more like an octopus 62% than a rabbit 12%"]);
  const compared = { probability: 0.27, before: { probability: 0.02 } };
  const regions = [{ node: "Head" }];
  const prompts = [{ prompt: "a cow", regions: [], likeness: judged }, { prompt: "a rabbit", regions, likeness: compared }, { prompt: "an owl", regions }];
  assert.deepEqual(findings({ prompts }).map(({ tone, text }) => [tone, text]), [["plain", "The region of “a rabbit” looks like it: 27%, 2% before"]]);
  assert.match(findings({ prompts: [{ prompt: "a rabbit", regions, likeness: { probability: 0.27 } }] })[0].text, /27%$/);
  const [front] = findings({ orientation: { turn_deg: 180, source: "found" } });
  assert.deepEqual([front.tone, front.text], ["plain", "Front: the side at 180°"]);
  const [undecided] = findings({ orientation: { turn_deg: 0, source: "undecided" } });
  assert.deepEqual([undecided.text, undecided.note], ["Front: the side at 0°", "0° is +Z, 90° is +X. No side is clearly the front."]);
  const [strange] = findings({ orientation: { turn_deg: 0, source: "unrecognised" } });
  assert.equal(strange.text, "Front: +Z");
  const carrier = { kind: "lattice", mirror: "x", level: true };
  const [known] = findings({ source_noun: { noun: "chair", probability: 0.64, recognised: true }, carrier });
  assert.match(known.text, /^Taken for: chair 64\s?%$/);
  assert.equal(known.note, "Kept: mirror symmetry across x, level and upright.");
  assert.deepEqual(findings({ source_noun: { noun: "chair", probability: 0.3, recognised: false }, carrier: { mirror: null, level: false } }), []);
  const [given] = findings({ orientation: { turn_deg: 45, source: "given" } });
  assert.equal(given.text, "Front: the side at 45°");
  assert.deepEqual(findings({ orientation: { turn_deg: 0, source: "kept" } }), []);
  assert.deepEqual(findings({ appearance: { notice: "It has no colours." } }).map(({ text, note }) => [text, note]), [["Seen as clay", "It has no colours."]]);
  assert.deepEqual(findings({ appearance: { notice: "" } }), []);
  const [drawn] = findings({ texture_stretch: { p50: 1, p95: 2.5, above_2: 0.1 } });
  assert.deepEqual([drawn.tone, drawn.text], ["warn", "Texture stretched 2.5×"]);
  assert.deepEqual(findings({ texture_stretch: null }), []);
  const [still] = findings({ movement: { stalled_by: "safeguard" }, warnings: ["The mesh hardly moved."] });
  assert.deepEqual([still.tone, still.text, still.note], ["warn", "Hardly moved", "The mesh hardly moved."]);
  const [coarse] = findings({ movement: { stalled_by: null }, warnings: ["90% of the surface is in large triangles."] });
  assert.deepEqual([coarse.tone, coarse.text], ["warn", "The source"]);
  assert.deepEqual(findings({ movement: { stalled_by: null }, warnings: [] }), []);
  assert.deepEqual(findings({ likeness: null }), []);
});

test("files are named after what is in them", () => {
  const job = { asset: { filename: "Duck (2).glb" }, prompt: "a tall vase!", params: { seed: 7 } };
  assert.equal(artifactName(job, "result.glb"), "duck-2-a-tall-vase-seed7.glb");
  assert.equal(artifactName(job, "report.json"), "duck-2-a-tall-vase-seed7-report.json");
  assert.equal(shapeName(job, "step120", 100), "duck-2-a-tall-vase-seed7-step120.glb");
  assert.equal(shapeName(job, "", 50), "duck-2-a-tall-vase-seed7-strength50.glb");
  assert.equal(artifactName({ asset: { filename: ".obj" }, prompt: "" }, "result.glb"), "asset-target-seed0.glb");
});

test("an open surface has no volume to speak of", () => {
  assert.equal(findings({ quality: { area_ratio: 2, volume_ratio: 0 } })[0].text, "Surface 2×");
  assert.equal(findings({ quality: { area_ratio: 2, volume_ratio: 3 } })[0].text, "Surface 2×, volume 3×");
  assert.deepEqual(skipped({ skipped: { border_edges: 1, zero_area_faces: 2, degenerate_faces: 0, primitives: [] } }), ["2 zero-area faces", "1 open edge"]);
});

test("prompts are put together from what a prior knows", () => {
  assert.deepEqual(adjectives(KNOWN), ["tall", "thin", "long"]);
  assert.equal(withNoun("", "octopus", KNOWN), "an octopus");
  assert.equal(withNoun("a tall vase", "giraffe", KNOWN), "a tall giraffe");
  assert.equal(withNoun("a giraffe with a long neck", "vase", KNOWN), "a vase");
  assert.equal(withAdjective("a vase", "thin", KNOWN), "a thin vase");
  assert.equal(withAdjective("a tall thin vase", "tall", KNOWN), "a thin vase");
  assert.equal(withAdjective("a giraffe with a long neck", "tall", KNOWN), "a tall giraffe with a long neck");
  assert.equal(surprise(KNOWN, () => 0), "a tall giraffe");
  assert.equal(surprise(KNOWN, () => 0.99), "a vase");
});

test("models are as the server names them, and none where it could not be asked", () => {
  assert.deepEqual(catalogue({}), { default: "", models: [], shapes: null });
  const found = catalogue({ default: "builtin", models: [{ id: "builtin", vocabulary: { nouns: ["cat", "vase"], groups: { animals: ["cat"], vessels: ["vase"] } } }, { id: "sd", available: null, vocabulary: null }, { id: "away", available: false, vocabulary: null }] });
  assert.equal(found.default, "builtin");
  assert.deepEqual(found.models[0].vocabulary?.groups, [["animals", ["cat"]], ["vessels", ["vase"]]]);
  assert.equal(found.models[1].vocabulary, null);
  assert.deepEqual(found.models.map(({ available }) => available), [true, true, false]);
});

test("words of the user's own come first, and are found whole in a prompt", () => {
  const own = { ...KNOWN, nouns: ["vase-stand", ...KNOWN.nouns], groups: { yours: ["vase-stand"], things: ["vase"] } };
  const { shapes } = catalogue({ models: [], default: "builtin", shapes: own });
  assert.deepEqual(ownNouns(shapes), ["vase-stand"]);
  assert.deepEqual(ownNouns({ ...KNOWN, groups: [] }), []);
  assert.equal(catalogue({}).shapes, null);
  assert.equal(nounIn("a tall vase stand", shapes).noun, "vase-stand");
  assert.equal(nounIn("a tall vase", shapes).noun, "vase");
  assert.equal(nounIn("a vasestand", shapes), null);
  assert.equal(withAdjective("a vase-stand with a long neck", "tall", shapes), "a tall vase-stand with a long neck");
  assert.equal(withNoun("a tall vase stand", "vase", shapes), "a tall vase");
});

test("a job that is asked for again has words as they are then, not as they were", () => {
  const params = { guidance: { kind: "exemplar", words: { fruit: "0".repeat(64) } }, seed: 1 };
  const job = { prompt: "a fruit", params, output: {}, files: { asset: {}, words: {} } };
  assert.equal("words" in wishOf(job, []).kept.params, false);
});

test("what only programs name is left out of sentences, and learnt from the schema", () => {
  learnNames({ properties: { seed: {}, max_run_s: {} }, $defs: { sds: { properties: { guidance_scale: {} } } } });
  assert.equal(plainWords("No part called legs. The asset has others; `parts` lists those."), "No part called legs.");
  assert.equal(plainWords("It took too long. Ask for a larger max_run_s, or set MESHDEFORM_MAX_RUN_S."), "It took too long.");
  assert.equal(plainWords("Set output.rig to follow."), "");
  assert.equal(plainWords("my_chair_v2.glb isn't supported."), "my_chair_v2.glb isn't supported.");
});
