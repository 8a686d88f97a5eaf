import assert from "node:assert/strict";
import { test } from "node:test";
import { parseRoute, permalinkHash, routeHash } from "../../service/web/app/router.js";

const JOB = "job_01kg9zqk2xf3v8c5m7n9p1r4t6";

test("every address of a view leads back to itself", () => {
  for (const hash of ["#/", `#/?from=${JOB}`, `#/?from=${JOB}&result=1`, "#/surface", `#/surface?from=${JOB}`, "#/surface?quick=1", "#/field", "#/many", "#/many/m1a2b3", "#/api", "#/usage", "#/jobs", "#/jobs?state=failed", "#/jobs?state=failed&q=duck+100%25", `#/jobs/${JOB}`, `#/shared/${JOB}/link.1769864400.mdk_1.0a`, "#/examples", "#/examples/kept-foot", `#/compare/${JOB}/${JOB}2`]) {
    assert.equal(routeHash(parseRoute(hash)), hash);
  }
});

test("what is no address leads nowhere, and never into a request", () => {
  assert.deepEqual(parseRoute(""), { name: "create", from: null });
  assert.deepEqual(parseRoute("#/?from=../../etc"), { name: "create", from: null });
  assert.deepEqual(parseRoute("#/jobs?state=odd"), { name: "jobs", state: null, search: "" });
  for (const hash of ["#/jobs/..%2Fkeys", "#/jobs/job_1/x", "#/groups/a%20b", "#/elsewhere", "#/examples/..%2Fx", "#/compare/job_1", "#/compare/job_1/..%2Fkeys", "#main", `#/shared/${JOB}`, `#/shared/${JOB}/key`, `#/shared/${JOB}/link.a%2F`, `#/shared/${JOB}/link.a/b`]) {
    assert.equal(parseRoute(hash).name, "unknown", hash);
  }
});

test("a link for other programs", () => {
  assert.equal(permalinkHash(`?job=${JOB}`), `#/jobs/${JOB}`);
  assert.equal(permalinkHash("?job=javascript:alert(1)"), null);
  assert.equal(permalinkHash(""), null);
});
