import assert from "node:assert/strict";
import { mock, test } from "node:test";

const asked = [];
/** @type {(Response | Error)[]} */
const answers = [];
Object.assign(globalThis, {
  document: Object.assign(new EventTarget(), { baseURI: "https://host.example/below/?job=job_1#/jobs" }),
  window: { sessionStorage: { getItem: () => "the-key" }, localStorage: null },
  async fetch(url, init) {
    asked.push({ url, key: init.headers.get("Authorization") });
    const next = answers.shift();
    if (next instanceof Error) throw next;
    return next;
  },
});
const { client, isAbort, isOffline, MeshdeformError } = await import("../../service/web/app/client.js");
const { described } = await import("../../service/web/app/problem-box.js");

const tooSoon = (/** @type {string} */ seconds) =>
  new Response(JSON.stringify({ code: "rate_limited", title: "Too many requests", detail: "Come later." }), { status: 429, headers: { "Retry-After": seconds } });
const ok = () => new Response('{"models":[]}');
const BROKEN = new TypeError("the line broke");

test("the page asks below its own folder, with the key that it keeps", async () => {
  answers.push(ok());
  await client.models();
  assert.deepEqual(asked.pop(), { url: "https://host.example/below/v1/models", key: "Bearer the-key" });
});

test("a limited rate is announced and waited for, but not longer than two minutes", async () => {
  /** @type {number[]} */
  const announced = [];
  document.addEventListener("ratelimited", (event) => announced.push(/** @type {CustomEvent} */ (event).detail));
  mock.timers.enable({ apis: ["setTimeout"] });
  try {
    answers.push(tooSoon("90"), ok());
    const waiting = client.models();
    while (!announced.length) await new Promise((resolve) => setImmediate(resolve));
    const before = asked.length;
    mock.timers.tick(89_000);
    assert.equal(asked.length, before);
    mock.timers.tick(2_000);
    assert.deepEqual(await waiting, { models: [] });
    assert.equal(asked.length, before + 1);
  } finally {
    mock.timers.reset();
  }
  answers.push(tooSoon("121"));
  await assert.rejects(client.models(), { code: "rate_limited" });
  assert.deepEqual(announced, [90]);
});

test("what a view reads fails at once, and what the user started is sent again", async () => {
  answers.push(BROKEN);
  await assert.rejects(client.get("job_1"), (error) => isOffline(error) && !isAbort(error));
  const before = asked.length;
  answers.push(BROKEN, new Response("{}", { status: 503 }), new Response('{"id":"job_2"}'));
  assert.equal((await client.retry("job_1")).id, "job_2");
  assert.equal(asked.length, before + 3);
});

test("an error is described in the page's words where nobody answers, and in the server's where it does", () => {
  const away = described(new MeshdeformError(0, { code: "unavailable", detail: "https://host.example does not answer." }));
  assert.equal(away.title, "The server does not answer.");
  assert.match(away.advice, /Nothing is lost/);
  const refused = new MeshdeformError(422, { code: "x", title: "Refused", detail: "No.", advice: "Try.", request_id: "r1" });
  assert.deepEqual(described(refused), { title: "Refused", detail: "No.", advice: "Try.", id: "r1" });
  assert.deepEqual(described(new MeshdeformError(502, {})), { title: "The service answered 502.", detail: "", advice: "", id: "" });
  assert.equal(described(new MeshdeformError(503, { code: "unavailable", title: "Down" })).title, "Down");
});
