import assert from "node:assert/strict";
import { test } from "node:test";

import { shapesOf } from "../../service/web/app/job/shapes.js";

test("the result of a deformation follows its checkpoints, and other kinds have checkpoints only", () => {
  const labels = (/** @type {object} */ job) => shapesOf({ id: "job_1", ...job }, [10, 20], 20).map(({ label }) => label);
  assert.deepEqual(labels({}), ["Step 10", "Result"]);
  assert.deepEqual(labels({ kind: "text_deform" }), ["Step 10", "Result"]);
  assert.deepEqual(labels({ kind: "surface_fit" }), ["Step 10", "Step 20"]);
  assert.deepEqual(labels({ kind: "text_deform", unreadable: "of another version" }), ["Step 10", "Step 20"]);
  assert.deepEqual(labels({ kind: "surface_fit", origin: { job_id: "job_0", step: 5 } }), ["Start", "Step 10", "Step 20"]);
});
