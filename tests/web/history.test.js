import assert from "node:assert/strict";
import { test } from "node:test";
import { emptyHistory, isTerminal, withEvent } from "../../service/web/app/history.js";

let seq = 0;
const event = (type, data = {}, attempt = 1) => ({
  seq: (seq += 1), job_id: "job_1", type, at: `2026-01-31T12:00:${String(seq).padStart(2, "0")}Z`, attempt, data,
});
const progress = (step, loss, attempt = 1) =>
  event("progress", { step, total_steps: 80, fraction: step / 80, phase: "optimizing", losses: { total: loss }, eta_s: 4, attempt }, attempt);
const told = (events) => events.reduce(withEvent, emptyHistory());

test("a job from its beginning to its end", () => {
  seq = 0;
  const events = [event("queued", { reason: "created" }, 0), event("started"), progress(10, 3), event("checkpoint", { step: 8 }), progress(20, 2)];
  const half = told(events);
  assert.equal(half.state, "running");
  assert.deepEqual(half.progress, { step: 20, total: 80, fraction: 0.25, phase: "optimizing", eta: 4 });
  assert.deepEqual(half.points, [{ step: 10, loss: 3 }, { step: 20, loss: 2 }]);
  assert.deepEqual(half.checkpoints, [8]);
  const over = withEvent(half, event("succeeded", { artifacts: ["result.glb"] }));
  assert.equal(over.state, "succeeded");
  assert.equal(over.progress.eta, null);
  assert.equal(over.startedAt, "2026-01-31T12:00:02Z");
  assert.deepEqual(over.lines.map((line) => line.text), ["Queued", "Started", "Step 8 saved", "Finished"]);
});

test("an event that comes twice changes nothing, and nothing is changed in place", () => {
  seq = 0;
  const first = Object.freeze(told([event("queued"), event("started")]));
  const next = progress(10, 3);
  const once = withEvent(first, next);
  assert.equal(withEvent(once, next), once);
  assert.equal(first.points.length, 0);
});

test("a later attempt's steps take the place of the earlier one's", () => {
  seq = 0;
  const lost = told([event("queued"), event("started"), progress(10, 3), progress(20, 2), progress(30, 1), event("recovered", { reason: "handed_back" })]);
  assert.equal(lost.state, "queued");
  const again = [event("started", {}, 2), progress(15, 9, 2), progress(25, 8, 2)].reduce(withEvent, lost);
  assert.deepEqual(again.points.map((point) => [point.step, point.loss]), [[10, 3], [15, 9], [25, 8]]);
  assert.match(again.lines.at(-1).text, /Started again/);
});

test("a lost worker is said until the job is as far again, and the percent is that of the step", () => {
  seq = 0;
  // The API's fraction never goes back.
  const behind = (step, attempt) => event("progress", { ...progress(step, 1, attempt).data, fraction: 0.5 }, attempt);
  const lost = told([event("queued"), event("started"), progress(40, 1), event("recovered", { reason: "lost" })]);
  assert.deepEqual([lost.losses, lost.interruption], [1, { reason: "lost", step: 40 }]);
  const again = [event("started", {}, 2), behind(32, 2)].reduce(withEvent, lost);
  assert.equal(again.progress.fraction, 0.4);
  assert.ok(again.interruption);
  assert.equal(withEvent(again, behind(41, 2)).interruption, null);
  seq = 0;
  // Handed back by a worker that was stopped: no attempt is counted.
  const calm = told([event("queued"), event("started"), progress(40, 1), event("recovered", { reason: "handed_back" }), event("started", {}, 2)]);
  assert.equal(calm.losses, 0);
});

test("a failure carries its error", () => {
  seq = 0;
  const error = { code: "worker_lost", title: "t", detail: "d", advice: "a" };
  assert.deepEqual(told([event("queued"), event("failed", { error })]).error, error);
  seq = 0;
  assert.deepEqual(told([event("queued"), event("failed", error)]).error, error);
});

test("which states are the end", () => {
  assert.deepEqual(["queued", "running", "canceling", "succeeded", "failed", "canceled", "expired"].filter(isTerminal), ["succeeded", "failed", "canceled", "expired"]);
});
