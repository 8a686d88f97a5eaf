import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { curlOf, matches, members, resolved, sections, typeOf } from "../../service/web/app/api/model.js";

const spec = JSON.parse(readFileSync(new URL("../../openapi/openapi.json", import.meta.url), "utf8"));
const all = sections(spec).flatMap(({ operations }) => operations);
const find = (/** @type {string} */ id) => /** @type {any} */ (all.find((each) => each.id === id));

test("every operation of the document is there once, in a section that says what it is", () => {
  const documented = Object.values(spec.paths).flatMap((methods) => Object.values(methods).map(({ operationId }) => operationId));
  assert.deepEqual(all.map(({ id }) => id).sort(), documented.sort());
  assert.ok(sections(spec).every(({ about }) => about));
});

test("members are those of objects, in lists and choices too, and every type has a name", () => {
  const job = members(spec, find("create_job").answers.find(({ status }) => status === "202").schema);
  const names = Object.fromEntries(job.map((each) => [each.name, each]));
  assert.equal(names.id.required, true);
  assert.match(names.state.type, /"queued" \| "running"/);
  assert.ok(members(spec, names.artifacts.schema).some(({ name }) => name === "sha256"));
  const params = job.find(({ name }) => name === "params");
  assert.ok(members(spec, params?.schema).length > 1, "one for each kind of job");
  const seen = new Set();
  const walk = (/** @type {any} */ schema) => {
    const key = JSON.stringify(schema);
    if (seen.has(key)) return;
    seen.add(key);
    assert.ok(typeOf(spec, schema), key);
    for (const each of members(spec, schema)) {
      assert.ok(each.name && each.type, key);
      if (each.schema) walk(each.schema);
    }
  };
  for (const { body, answers } of all) for (const schema of [body?.schema, ...answers.map((each) => each.schema)]) if (schema) walk(schema);
  assert.ok(seen.size > 100);
  assert.deepEqual(resolved(spec, { $ref: "#/components/schemas/UsageMonth" }).required, ["month", "jobs", "seconds", "bytes"]);
});

test("every request has a line of curl with nothing left open", () => {
  for (const operation of all) {
    const line = curlOf(spec, operation, "https://host.example/", true);
    assert.doesNotMatch(line.split("https://host.example")[1], /[{}]|undefined/, operation.id);
    assert.equal(line.includes("Authorization"), !operation.open, operation.id);
  }
  assert.equal(curlOf(spec, find("get_usage"), "https://host.example/", false), "curl -sS https://host.example/v1/usage");
  assert.match(curlOf(spec, find("create_upload"), "https://host.example/", false), /-X POST .*\n.*Content-Type: application\/json.*\n.*--data-raw '\{"filename"/);
  assert.match(curlOf(spec, find("create_job"), "https://host.example/", false), /-F asset=@asset\.glb/);
});

test("requests are found by words of their method, path or summary", () => {
  assert.deepEqual(all.filter((each) => matches(each, "get usage")).map(({ id }) => id), ["get_usage"]);
  assert.ok(all.filter((each) => matches(each, "")).length === all.length);
  assert.equal(all.some((each) => matches(each, "nothing like this")), false);
});
