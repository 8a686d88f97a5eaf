import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { guideFiles, guideParams, noGuide, targetsOf } from "../../service/web/app/create/guide/model.js";
import { estimateWords } from "../../service/web/app/format.js";
import { groupsOf, isUnused } from "../../service/web/app/groups.js";
import { continued, documentOf, isByShape, wishOf } from "../../service/web/app/params.js";
import { findings } from "../../service/web/app/quality.js";

const WISH = { prompt: "a giraffe", model: "builtin", preset: "preview", seed: 7, subdivide: false, strength: "", kept: { params: {}, output: {} }, byShape: true };
const openapi = JSON.parse(readFileSync(new URL("../../openapi/openapi.json", import.meta.url), "utf8"));
// The server says what a schema cannot: which of the common parameters a fit does without.
const GROUPS = groupsOf({ ...openapi.components.schemas.DeformParams, $defs: openapi.components.schemas, "x-unused": { exemplar: ["steps", "carrier", "preset", "checkpoint_every_steps"] } });

/** @param {any} more Of the wish. */
const asked = (more = {}) => documentOf({ ...WISH, ...more }, 20, GROUPS);

test("by shape, a request has what a fit takes, and nothing of the model's", () => {
  const kept = { params: { steps: 40, carrier: "lattice", guidance_scale: 9, negative_prompt: "a chair" }, output: {} };
  assert.deepEqual(asked({ kept, strength: "0.9" }), { prompt: "a giraffe", params: { seed: 7, guidance: { kind: "exemplar", strength: 0.9 } }, output: {} });
  // The model, on the other hand, has no such strength.
  assert.deepEqual(asked({ strength: "0.9", byShape: false }).params.guidance, { kind: "sds", model: "builtin" });
});

test("the form shows what the way has", () => {
  const shown = (/** @type {string} */ kind) => ["preset", "model", "orientation"].filter((name) => !isUnused(name, kind, GROUPS));
  assert.deepEqual(shown("exemplar"), ["orientation"]);
  assert.deepEqual(shown("sds"), ["preset", "model", "orientation"]);
  assert.deepEqual(shown("target"), ["preset"]);
});

test("one target is pushed or fitted to, and of several the nearest is fitted to", () => {
  const guide = noGuide();
  assert.deepEqual(guideParams(guide, 1, ""), { guidance: "target" });
  assert.deepEqual(guideParams(guide, 1, "", true), { guidance: "exemplar" });
  for (const byShape of [false, true]) assert.deepEqual(guideParams(guide, 2, "", byShape), { guidance: "exemplar" });
  // What a job said of its own target is kept.
  const kept = { params: { align: "none" }, output: {} };
  const document = asked({ prompt: "", guide: { ...guide, targets: 2 }, kept });
  assert.deepEqual(document, { params: { seed: 7, guidance: { kind: "exemplar", align: "none" } }, output: {} });

  const files = guideFiles(["a", "b", "c"], []);
  assert.deepEqual(files, { target: "a", target_2: "b", target_3: "c" });
  assert.deepEqual(targetsOf({ asset: "x", silhouette_1: "y", target_3: "c", target_2: "b", target: "a" }), ["a", "b", "c"]);
});

test("pictures stand beside a prompt by shape, and without one alone", () => {
  const guide = { ...noGuide(), pictures: [{ azimuth: 0, elevation: 0 }] };
  assert.deepEqual(guideParams(guide, 0, "a cat", true), { guidance: "exemplar", silhouettes: guide.pictures });
  assert.deepEqual(guideParams(guide, 0, "", true), { guidance: "silhouettes", silhouettes: guide.pictures });
});

test("a job by shape fills the form again", () => {
  const params = { seed: 3, guidance: { kind: "exemplar", strength: 0.8, orientation: 90 } };
  const job = { prompt: "a cat", params, output: {}, files: { asset: {} } };
  const wish = wishOf(job);
  assert.deepEqual([wish.byShape, wish.strength, wish.control?.front, wish.kept.params], [true, "0.8", "90", {}]);
  assert.deepEqual(documentOf(wish, null, GROUPS), { prompt: "a cat", params, output: {} });
  const several = { ...job, prompt: "", files: { asset: {}, target: {}, target_2: {} } };
  assert.equal(wishOf(several).guide?.targets, 2);
  assert.ok(isByShape(job));
});

test("what the asset was fitted to", () => {
  const member = { noun: "giraffe", form: "giraffe", pose: "lying", attributes: ["fat", "long neck"] };
  const fit = { member, target: null, kept: 0.93, left_over: ["saddle"], missing: ["horn", "horn", "mane"] };
  assert.deepEqual(findings({ exemplars: [fit] }), [{
    tone: "plain",
    text: "Fitted to a fat giraffe, lying: 93% of the way",
    note: "Only your asset has: saddle. Only that shape has: horn, mane.",
  }]);
  const said = (/** @type {any} */ more) => findings({ exemplars: [more] }, { target_2: { filename: "tall.glb" } })[0].text;
  assert.equal(said({ member: { noun: "chair", form: "office-chair", pose: "" } }), "Fitted to an office chair");
  assert.equal(said({ member: { noun: "bird", form: "general", pose: "spread" }, kept: 1 }), "Fitted to a bird, wings spread: 100% of the way");
  assert.equal(said({ member: { target: 1 }, target: "target_2" }), "Fitted to tall.glb");
  assert.equal(said({ member: { noun: "cat", form: "standing-cat", way: "mould" } }), "Moulded into a standing cat");
});

test("a fit is not told in steps", () => {
  const found = (/** @type {any} */ guidance, /** @type {number} */ steps) => ({ params: { guidance }, estimate: { queue_s: null, run_s: 3, steps } });
  assert.deepEqual([["exemplar", 20], ["sds", 20], ["exemplar", 0]].map(([kind, steps]) => estimateWords(found(kind, Number(steps)))), [
    "A fit, about 3 s.", "20 steps, about 3 s.", "A change in plain words, about 3 s.",
  ]);
});

test("what goes on from a result is made as the result was, without what the result was asked for", () => {
  const asked = (/** @type {any} */ guidance) => wishOf(continued({ prompt: "a vase", asset: { filename: "cube.glb", size: 1 }, params: { seed: 3, guidance }, files: { target: {} }, output: { subdivide: true } }));
  const { prompt, byShape, subdivide, guide } = asked({ kind: "exemplar", strength: 0.5 });
  assert.deepEqual([prompt, byShape, subdivide, guide?.targets], ["", true, false, 0]);
  assert.deepEqual([asked({ kind: "target" }).byShape, asked({ kind: "sds", model: "builtin" }).byShape], [true, false]);
});
