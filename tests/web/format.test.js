import assert from "node:assert/strict";
import { test } from "node:test";
import { ago, bytes, counted, duration, figure, goalWords, jobTitle, percent, phaseWords, roughly } from "../../service/web/app/format.js";

test("bytes", () => {
  assert.deepEqual([0, 999, 1000, 115548, 999499, 999500, 104857600, 5e12].map(bytes), ["0 B", "999 B", "1.0 kB", "116 kB", "999 kB", "1.0 MB", "105 MB", "5.0 TB"]);
});

test("durations", () => {
  assert.deepEqual([0.2, 1, 59.4, 59.6, 125, 3600, 11520, 3 * 86400].map(duration), ["under 1 s", "1 s", "59 s", "1 min", "2 min 5 s", "1 h", "3 h 12 min", "3 days"]);
  assert.equal(duration(Number.NaN), "–");
  assert.deepEqual([0.4, 7.2, 33, 100, 1000].map(roughly), ["a second", "7 s", "35 s", "1 min 30 s", "17 min"]);
});

test("times", () => {
  const now = Date.parse("2026-01-31T12:00:00Z");
  assert.deepEqual(
    ["2026-01-31T11:59:30Z", "2026-01-31T11:56:00Z", "2026-01-31T09:00:00Z", "2026-01-29T12:00:00Z", "no time"].map((at) => ago(at, now)),
    ["just now", "4 min ago", "3 h ago", "2 days ago", ""],
  );
});

test("figures have three digits that say something", () => {
  assert.deepEqual([0, 2.900179, 116.527, 1234567, 0.000012, Infinity].map(figure), ["0", "2.9", "117", "1.2e6", "1.2e-5", "–"]);
  assert.deepEqual([counted(1, "face"), counted(5120, "face"), counted(2, "vertex", "vertices")], ["1 face", "5,120 faces", "2 vertices"]);
  // 0.29 * 100 is a little less than 29.
  assert.equal(percent(0.29), "29%");
  assert.deepEqual([0.999, 1, -1].map(percent), ["99%", "100%", "0%"]);
  assert.deepEqual(["optimizing", "thinking", ""].map((phase) => phaseWords(phase)), ["Deforming", "Thinking", ""]);
  assert.equal(phaseWords("writing"), "Writing the file");
});

test("a job is named after its prompts", () => {
  assert.equal(goalWords({ prompt: "a vase", params: {} }), "a vase");
  assert.equal(goalWords({ prompt: "a vase", params: { guidance: { prompts: [{ prompt: "a bell", weight: 2 }] } } }), "a vase + a bell");
  assert.equal(goalWords({ prompt: "" }), "");
  const others = [{ prompt: "", files: { target: {} } }, { prompt: "", files: { target: {}, target_2: {} } }, { prompt: "" }, { prompt: "", kind: "surface_fit" }, { prompt: "", kind: "a_new_kind" }];
  assert.deepEqual(others.map(jobTitle), ["To a target mesh", "To the nearest of several meshes", "To pictures", "Surface fit", "a new kind"]);
});

test("of a job that only another version can read, nothing is read but its prompt", () => {
  const odd = { unreadable: "no such member", params: { prompts: 3, target: null } };
  assert.equal(goalWords({ ...odd, prompt: "a vase" }), "a vase");
  assert.deepEqual([odd, { ...odd, kind: "image_deform" }, { ...odd, kind: "prior_teach" }].map(jobTitle), ["text deform", "image deform", "A lesson"]);
});
