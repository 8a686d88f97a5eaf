import assert from "node:assert/strict";
import { test } from "node:test";
import { checkpointEvery, documents, fieldProblem, FIELDS, keptText, nothingKept, randomSeed, wishOf } from "../../service/web/app/params.js";

const WISH = { prompt: " a mushroom ", model: "builtin", preset: "preview", seed: 7, variations: 1, morph: false, advanced: {}, kept: { params: {}, output: {} } };
const field = (name) => FIELDS.find((found) => found.name === name);

test("one job asks for what was chosen and nothing else", () => {
  assert.deepEqual(documents(WISH, 80, "g"), [
    { prompt: "a mushroom", params: { preset: "preview", model: "builtin", checkpoint_every_steps: 8, seed: 7 }, output: { morph: false } },
  ]);
});

test("variations differ by their seed and share a label", () => {
  const found = documents({ ...WISH, variations: 3 }, 80, "g1");
  assert.deepEqual(found.map((document) => document.params.seed), [7, 8, 9]);
  assert.deepEqual(found.map((document) => document.metadata), [1, 2, 3].map((number) => ({ group: "g1", variation: String(number) })));
});

test("what was typed under Advanced goes along as numbers; what is empty or wrong does not", () => {
  const advanced = { steps: "40", learning_rate: " 0.01 ", safeguard: "none", noise_draws: "2.5", guidance_scale: "" };
  const { params } = documents({ ...WISH, advanced }, 80, "g")[0];
  assert.deepEqual(params, { preset: "preview", model: "builtin", steps: 40, learning_rate: 0.01, safeguard: "none", checkpoint_every_steps: 4, seed: 7 });
});

test("what is wrong is said", () => {
  assert.equal(fieldProblem(field("steps"), ""), "");
  assert.match(fieldProblem(field("steps"), "2.5"), /whole/);
  assert.match(fieldProblem(field("steps"), "many"), /number/);
  assert.match(fieldProblem(field("steps"), "0"), /At least 1/);
  assert.match(fieldProblem(field("steps"), "60000"), /50,000/);
});

test("ten shapes on the way, at least one step apart", () => {
  assert.deepEqual([1, 4, 80, 5000].map(checkpointEvery), [1, 1, 8, 500]);
});

test("a job's own parameters fill the form again, and what it has no field for is kept", () => {
  const job = {
    prompt: "a vase",
    params: { preset: "paper", seed: 3, learning_rate: 0.01, views: "random_batch", checkpoint_every_steps: 7 },
    output: { morph: true, usd: true },
  };
  const kept = { params: { views: "random_batch" }, output: { usd: true } };
  const wish = wishOf(job);
  assert.deepEqual(wish, { prompt: "a vase", model: "", preset: "paper", seed: 3, variations: 1, morph: true, advanced: { learning_rate: "0.01" }, kept });
  const [document] = documents(wish, null, "g");
  assert.deepEqual(document, {
    prompt: "a vase", params: { preset: "paper", seed: 3, learning_rate: 0.01, views: "random_batch" }, output: { morph: true, usd: true },
  });
  assert.equal(keptText(kept), "views random_batch, output.usd true");
  assert.equal(keptText(nothingKept()), "");
});

test("seeds by chance are whole and not negative", () => {
  assert.deepEqual([0, 0.5, 0.9999999].map((chance) => randomSeed(() => chance)), [0, 50000, 99999]);
});
