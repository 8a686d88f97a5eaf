import assert from "node:assert/strict";
import { test } from "node:test";
import { askedRows, figureRows, obstacle } from "../../service/web/app/compare/model.js";

const job = (prompt, params, more = {}) => ({ kind: "text_deform", state: "succeeded", prompt, params, output: {}, files: {}, asset: { filename: "vase.glb" }, ...more });
const values = (rows, label) => rows.find((row) => row.label === label)?.values;

test("what tells jobs apart is always said, other parameters only where they differ", () => {
  const jobs = [job("a lamp", { preset: "preview", seed: 3, steps: 40 }), job("a lamp", { seed: 3, control: { regions: [{ node: "Head", action: "keep" }] } }, { output: { morph: true } })];
  const reports = [{ params: { model: "builtin", steps: 40, learning_rate: 0.03 } }, { params: { model: "builtin", steps: 200, learning_rate: 0.03 } }];
  const rows = askedRows(jobs, reports);
  assert.deepEqual(values(rows, "Prompt"), ["a lamp", "a lamp"]);
  assert.deepEqual(values(rows, "Quality"), ["Preview", "Balanced"]);
  assert.deepEqual(values(rows, "steps"), ["40", "200"]);
  assert.equal(values(rows, "learning_rate"), undefined);
  assert.deepEqual(values(rows, "Control"), ["", "Keep: Node Head"]);
  assert.deepEqual(values(rows, "output.morph"), ["", "true"]);
  assert.deepEqual(rows.filter(({ same }) => !same).map(({ label }) => label), ["Quality", "Control", "steps", "output.morph"]);
});

test("without a report only what was written can differ", () => {
  const rows = askedRows([job("a lamp", { steps: 40 }), job("a cup", {})], [null, { params: { steps: 200 } }]);
  assert.deepEqual(values(rows, "steps"), ["40", ""]);
});

test("figures stand side by side, and those that nobody has are left out", () => {
  const rows = figureRows([
    { quality: { flipped_faces: 0, symmetric_dirichlet_p99: 2.5 }, likeness: { noun: "lamp", probability: 0.9 }, seconds: { read: 1, optimize: 9 } },
    { quality: { flipped_faces: 0 }, posed_quality: { flipped_faces: 12, kept_share: 0.9 } },
  ]);
  assert.deepEqual(rows.map(({ label, values: found }) => [label, ...found]), [
    ["Looks like", "lamp 90%", ""], ["Still your asset", "", "90%"], ["Flipped faces", "0", "12"], ["Distortion, 99th percentile", "2.5", ""], ["Time", "10 s", ""],
  ]);
  const [fitted, pushed] = ["exemplar", "prompt"].map((way) => ({ way, params: { steps: 5000 } }));
  assert.deepEqual(values(figureRows([fitted, pushed]), "Steps"), ["", "5,000"]);
  assert.deepEqual(figureRows([null, null]), []);
});

test("two results are compared by what they are worth first, and only a good one is still the asset", () => {
  const [good, bad] = ["good", "keep_source"].map((value) => ({ verdict: { value, reasons: [], advice: [] }, quality: { kept_share: 0.9 } }));
  const rows = figureRows([good, bad]);
  assert.deepEqual(rows.map(({ label, values: found }) => [label, ...found]), [["Verdict", "Good", "Better keep your asset"], ["Still your asset", "90%", ""]]);
});

test("why a job has nothing to compare", () => {
  assert.equal(obstacle(job("a lamp", {})), "");
  assert.match(obstacle(job("a lamp", {}, { state: "running" })), /not finished yet/);
  assert.match(obstacle(job("a lamp", {}, { state: "expired" })), /no result: expired/);
  assert.match(obstacle(job("", {}, { kind: "surface_fit" })), /no shape/);
});
