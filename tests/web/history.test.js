import assert from "node:assert/strict";
import { test } from "node:test";
import { emptyHistory, isTerminal, withEvent } from "../../service/web/app/history.js";

let seq = 0;
const event = (type, data = {}, attempt = 1) => ({
  seq: (seq += 1), job_id: "job_1", type, at: `2026-01-31T12:00:${String(seq).padStart(2, "0")}Z`, attempt, data,
});
const progress = (step, attempt = 1) => event("progress", { step, total_steps: 80, fraction: step / 80, phase: "optimizing", eta_s: 4, attempt }, attempt);
const told = (events) => events.reduce(withEvent, emptyHistory());

test("a job from its beginning to its end", () => {
  seq = 0;
  const events = [event("queued", { reason: "created" }, 0), event("started"), progress(10), event("checkpoint", { step: 8 }), progress(20)];
  const half = told(events);
  assert.equal(half.state, "running");
  assert.deepEqual(half.progress, { step: 20, total: 80, fraction: 0.25, phase: "optimizing", eta: 4 });
  assert.deepEqual(half.checkpoints, [8]);
  const over = withEvent(half, event("succeeded", { artifacts: ["result.glb"] }));
  assert.equal(over.state, "succeeded");
  assert.equal(over.progress.eta, null);
  assert.equal(over.startedAt, "2026-01-31T12:00:02Z");
});

test("an event that comes twice changes nothing, and nothing is changed in place", () => {
  seq = 0;
  const first = Object.freeze(told([event("queued"), event("started")]));
  const next = progress(10);
  const once = withEvent(first, next);
  assert.equal(withEvent(once, next), once);
  assert.equal(first.progress.step, 0);
});

test("a lost worker is said until the job is as far again, and the percent is that of the step", () => {
  seq = 0;
  // The API's fraction never goes back.
  const behind = (step, attempt) => event("progress", { ...progress(step, attempt).data, fraction: 0.5 }, attempt);
  const lost = told([event("queued"), event("started"), progress(40), event("recovered", { reason: "lost" })]);
  assert.equal(lost.state, "queued");
  assert.deepEqual([lost.losses, lost.interruption], [1, { reason: "lost", step: 40 }]);
  const again = [event("started", {}, 2), behind(32, 2)].reduce(withEvent, lost);
  assert.equal(again.progress.fraction, 0.4);
  assert.ok(again.interruption);
  assert.equal(withEvent(again, behind(41, 2)).interruption, null);
  seq = 0;
  // Handed back by a worker that was stopped: no attempt is counted.
  const calm = told([event("queued"), event("started"), progress(40), event("recovered", { reason: "handed_back" }), event("started", {}, 2)]);
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
