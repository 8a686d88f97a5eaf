import assert from "node:assert/strict";
import { readFileSync, readdirSync } from "node:fs";
import { test } from "node:test";

import { messages } from "../../service/web/client/events.js";
import { Client, MeshdeformError } from "../../service/web/client/index.js";

const BASE = "https://host.example/below/";
const WEB = new URL("../../service/web/", import.meta.url);

/** @param {unknown} body @param {number} [status] @param {Record<string, string>} [headers] */
function answer(body, status = 200, headers = {}) {
  return new Response(typeof body === "string" ? body : JSON.stringify(body), { status, headers });
}

/**
 * A client whose requests get these answers in turn, and what was asked. An answer may be an error, which the network throws.
 *
 * @param {(Response | Error)[]} answers
 * @param {import("../../service/web/client/transport.js").Options} [options]
 */
function scripted(answers, options = {}) {
  /** @type {{url: string, method: string, key: string | null, init: RequestInit}[]} */
  const asked = [];
  const client = new Client({
    baseUrl: BASE,
    async fetch(url, init) {
      asked.push({ url: String(url), method: init.method, key: new Headers(init.headers).get("Authorization"), init });
      const next = answers.shift();
      assert.ok(next, `one request too many: ${url}`);
      if (next instanceof Error) throw next;
      return next;
    },
    ...options,
  });
  return { client, asked };
}

/** Run with a clock that needs no time; returns the waits in milliseconds. @param {() => Promise<void>} work */
async function withoutWaiting(work) {
  const { setTimeout: real, clearTimeout: clear } = globalThis;
  /** @type {number[]} */
  const waits = [];
  globalThis.setTimeout = (/** @type {any} */ action, /** @type {number} */ ms) => {
    if (ms >= 45_000) return 0; // the watch over a silent connection
    waits.push(ms);
    return setImmediate(action);
  };
  globalThis.clearTimeout = (/** @type {any} */ timer) => timer && clearImmediate(timer);
  try {
    await work();
  } finally {
    Object.assign(globalThis, { setTimeout: real, clearTimeout: clear });
  }
  return waits;
}

const BROKEN = new TypeError("the line broke");
const tooSoon = (/** @type {string} */ seconds) => answer({ code: "rate_limited", detail: "Too soon." }, 429, { "Retry-After": seconds });

test("below a path, every address is below it, also those that the service names itself", async () => {
  const { client, asked } = scripted([answer({ id: "job_1" }), answer({ url: "/v1/x?signature=1", expires_at: "" })]);
  await client.get("job_1");
  assert.equal(asked[0].url, "https://host.example/below/v1/jobs/job_1");
  assert.equal((await client.signedUrl("job_1")).url, "https://host.example/below/v1/x?signature=1");
  assert.equal(client.url("web/parameters.json"), "https://host.example/below/web/parameters.json");
  assert.equal(client.url("https://bucket.example/a"), "https://bucket.example/a");
});

test("the key is asked for before every request, and sent to the service only", async () => {
  let key = "";
  const { client, asked } = scripted([answer({}), answer({}), answer("x")], { apiKey: () => key });
  await client.limits();
  key = "second";
  await client.limits();
  await client.request("https://host.example/elsewhere");
  assert.deepEqual(asked.map((found) => found.key), [null, "Bearer second", null]);
});

test("a refused key is asked for again until there is none, and the request goes on with the new one", async () => {
  const refused = () => answer({ code: "unauthorized", title: "No key", detail: "Send a key." }, 401);
  let key = "";
  const keys = ["wrong", "right"];
  /** @type {string[]} */
  const seen = [];
  const onUnauthorized = async (/** @type {string} */ old) => {
    seen.push(old);
    key = keys.shift() ?? "";
    return key !== "";
  };
  const { client, asked } = scripted([refused(), refused(), answer({ models: [] }), refused()], { apiKey: () => key, onUnauthorized });
  assert.deepEqual(await client.models(), { models: [] });
  assert.deepEqual(seen, ["", "wrong"]);
  assert.equal(asked[2].key, "Bearer right");
  await assert.rejects(client.models(), (/** @type {MeshdeformError} */ error) => error.status === 401 && error.title === "No key" && error.message === "Send a key.");
});

test("requests that came too soon are repeated as long as time is left, and announced", async () => {
  /** @type {any[]} */
  const told = [];
  const { client } = scripted([...Array.from({ length: 9 }, () => tooSoon("3")), answer({ models: [] })], {
    onRetry: (error, retry) => void told.push([error.retryAfterS, retry.keyed, retry.failures]),
  });
  const waits = await withoutWaiting(async () => void (await client.models()));
  assert.equal(waits.length, 9);
  assert.ok(waits.every((wait) => wait >= 3000 && wait <= 3250), String(waits));
  assert.deepEqual(told, Array.from({ length: 9 }, () => [3, false, 0]));
  const impatient = scripted([tooSoon("61")]);
  await assert.rejects(impatient.client.models(), { code: "rate_limited" });
  const never = scripted([tooSoon("1")], { maxRetries: 0 });
  await assert.rejects(never.client.models(), { code: "rate_limited" });
});

test("whoever calls may give up before a request is repeated, and knows whether it is carried out once", async () => {
  const onRetry = (/** @type {any} */ _, /** @type {{keyed: boolean}} */ { keyed }) => keyed;
  const read = scripted([BROKEN], { onRetry });
  await assert.rejects(read.client.models(), (/** @type {MeshdeformError} */ error) => error.unanswered);
  const posted = scripted([BROKEN, answer({}, 503), answer({ id: "job_2" })], { onRetry });
  const waits = await withoutWaiting(async () => void assert.equal((await posted.client.retry("job_1")).id, "job_2"));
  assert.equal(waits.length, 2);
  const keys = new Set(posted.asked.map(({ init }) => new Headers(init.headers).get("Idempotency-Key")));
  assert.equal(keys.size, 1);
  assert.ok(![...keys].includes(null));
});

test("an answer that breaks off is no answer: it is fetched again", async () => {
  const half = () => new Response(new ReadableStream({
    start(controller) {
      controller.enqueue(new Uint8Array(3));
      controller.error(BROKEN);
    },
  }));
  const { client } = scripted([half(), answer("whole"), half(), answer({ id: "job_1" }), half()]);
  await withoutWaiting(async () => {
    assert.equal(new TextDecoder().decode(await client.bytes("v1/jobs/job_1/asset")), "whole");
    assert.equal((await client.get("job_1")).id, "job_1");
  });
  await assert.rejects(client.bytes("v1/jobs/job_1/asset", { once: true }), { name: "MeshdeformError", code: "unavailable", status: 0 });
});

test("a pause after no answer ends when the browser is online again, and one that the service asks for does not", async () => {
  const network = new EventTarget();
  const names = /** @type {const} */ (["addEventListener", "removeEventListener"]);
  for (const name of names) Object.assign(globalThis, { [name]: network[name].bind(network) });
  try {
    const { client, asked } = scripted([BROKEN, answer({ models: [] })], { onRetry: () => void setImmediate(() => network.dispatchEvent(new Event("online"))) });
    const { setTimeout: real } = globalThis;
    globalThis.setTimeout = /** @type {any} */ (() => 0); // no time passes
    try {
      await client.models();
    } finally {
      globalThis.setTimeout = real;
    }
    assert.equal(asked.length, 2);
    const limited = scripted([tooSoon("1"), answer({ models: [] })], { onRetry: () => void network.dispatchEvent(new Event("online")) });
    const waits = await withoutWaiting(async () => void (await limited.client.models()));
    assert.ok(waits[0] >= 1000);
  } finally {
    for (const name of names) Reflect.deleteProperty(globalThis, name);
  }
});

test("a large file goes with its job where uploads go to another host and that is forbidden", async () => {
  const file = new File([new Uint8Array((1 << 20) + 1)], "large.glb");
  const made = { id: "upl_1", state: "waiting", resumable: false, url: "https://bucket.example/x", method: "PUT", headers: {} };
  const { client, asked } = scripted([answer(made), answer({ id: "job_1" }), answer(made)], { directUploads: false });
  await client.submit(file, { prompt: "a vase" });
  assert.deepEqual(asked.map(({ url }) => url.slice(BASE.length)), ["v1/uploads", "v1/jobs"]);
  assert.equal(/** @type {FormData} */ (asked[1].init.body).get("asset")?.size, file.size);
  await assert.rejects(client.upload(file), { code: "upload_elsewhere" });
});

test("an upload tells what the service has: from before, and after every piece", async () => {
  const size = (192 << 10) + 3;
  const made = { id: "upl_1", state: "waiting", resumable: true, offset: 3, url: "/v1/uploads/upl_1/content?signature=x", method: "PUT", headers: {} };
  const { client, asked } = scripted([answer(made), answer({}), answer({}), answer({ ...made, state: "complete" })], { apiKey: "the-key" });
  /** @type {number[]} */
  const told = [];
  assert.equal((await client.upload(new Uint8Array(size), { onProgress: (bytes) => told.push(bytes) })).state, "complete");
  assert.deepEqual(told, [3, (64 << 10) + 3, size]);
  assert.deepEqual(asked.map(({ method, url, key }) => [method, url.slice(BASE.length), key]), [
    ["POST", "v1/uploads", "Bearer the-key"],
    ["PUT", "v1/uploads/upl_1/content?signature=x", null],
    ["PUT", "v1/uploads/upl_1/content?signature=x", null],
    ["POST", "v1/uploads/upl_1/complete", "Bearer the-key"],
  ]);
});

const STREAM = 'retry: 2000\n\nid: 1\nevent: queued\ndata: {"seq":1,"type":"queued"}\n\n: nothing new\n\nid: 2\nevent: progress\ndata: {"seq":2,\ndata: "type":"progress"}\n\n';
const FOUND = [2000, { seq: 1, type: "queued" }, { seq: 2, type: "progress" }];

/** @param {(string | Error)[]} pieces */
function stream(...pieces) {
  const bytes = pieces.map((piece) => (typeof piece === "string" ? new TextEncoder().encode(piece) : piece));
  return new ReadableStream({
    pull(controller) {
      const next = bytes.shift();
      if (next === undefined) controller.close();
      else if (next instanceof Error) controller.error(next);
      else controller.enqueue(next);
    },
  });
}

/** @param {(string | Error)[]} pieces */
async function parsed(...pieces) {
  const found = [];
  for await (const each of messages(stream(...pieces))) found.push(each);
  return found;
}

test("wherever a stream is cut, and whichever its line ends are, the events are the same", async () => {
  for (const end of ["\n", "\r\n", "\r"]) {
    const text = STREAM.replaceAll("\n", end) + ":" + end;
    assert.deepEqual(await parsed(text), FOUND);
    for (let cut = 1; cut < text.length; cut += 1) {
      assert.deepEqual(await parsed(text.slice(0, cut), text.slice(cut)), FOUND, `cut at ${cut}, ${JSON.stringify(end)}`);
    }
  }
});

test("what is not complete is no event, nor is what a newer service sends; a byte order mark is not read", async () => {
  assert.deepEqual(await parsed('data: {"seq":1,"type":"queued"}\n'), []);
  assert.deepEqual(await parsed('data: hello\n\ndata: {"seq":"1"}\n\nretry: soon\n\n'), []);
  assert.deepEqual(await parsed('\ufeffdata:{"seq":1,"type":"queued"}\n\n'), [FOUND[1]]);
});

/** @param {...(string | Error)} pieces */
const events = (...pieces) => new Response(stream(...pieces), { headers: { "Content-Type": "text/event-stream" } });

test("a stream that breaks goes on where it stopped: at once after a good connection, then as late as the service asks", async () => {
  const end = 'data: {"seq":3,"type":"succeeded"}\n\n';
  const { client, asked } = scripted([events(STREAM, BROKEN), BROKEN, answer("", 500), events(STREAM + end)]);
  /** @type {unknown[]} */
  const seen = [];
  const waits = await withoutWaiting(async () => {
    for await (const event of client.watch("job_1", { onConnection: (on) => seen.push(on) })) seen.push(event.seq);
  });
  assert.deepEqual(seen, [true, 1, 2, false, false, false, true, 3]);
  assert.deepEqual(asked.map(({ init }) => new Headers(init.headers).get("Last-Event-ID")), ["0", "2", "2", "2"]);
  assert.ok(waits[0] <= 250, String(waits));
  assert.ok(waits.slice(1).every((wait) => wait >= 2000 && wait < 4000), String(waits));
});

test("a job that is gone ends the stream, and a connection is tried no longer than wanted", async () => {
  const gone = scripted([answer({ code: "not_found", detail: "There is no job." }, 404)]);
  await assert.rejects(gone.client.watch("job_1").next(), { code: "not_found" });
  const away = scripted([BROKEN]);
  await assert.rejects(away.client.watch("job_1", { timeoutMs: 0 }).next(), { code: "unavailable" });
});

test("every module of the page finds what it imports", () => {
  const files = readdirSync(WEB, { recursive: true }).map(String).filter((name) => /^(app|viewer|client)\/.*\.js$/.test(name));
  assert.ok(files.length > 40);
  for (const name of files) {
    const text = readFileSync(new URL(name, WEB), "utf8");
    for (const [, names, from] of text.matchAll(/^(?:import|export) (?:\{([^}]*)\}|\*(?: as \w+)?)? ?(?:from )?"(\.[^"]+)";/gm)) {
      const target = new URL(from, new URL(name, WEB));
      const other = readFileSync(target, "utf8");
      if (!names || target.pathname.includes("/vendor/")) continue;
      for (const wanted of names.split(",").map((each) => each.trim().split(" as ")[0]).filter(Boolean)) {
        const exported = new RegExp(`^export (?:async )?(?:function\\*?|class|const|let) ${wanted}\\b|^export \\{[^}]*\\b${wanted}\\b|^export \\* from`, "m");
        assert.match(other, exported, `${name} imports ${wanted} of ${from}`);
      }
    }
  }
});

test("what a result is worth is read from its report, whichever version wrote it", async () => {
  const verdict = { value: "keep_source", reasons: ["It broke."], advice: ["Try “a van”."], structure: {} };
  const { client, asked } = scripted([answer({ verdict }), answer({ verdict: { value: "keep_result", reasons: [] } }), answer({ levels: [] })]);
  assert.deepEqual(await client.verdict("job_1"), { value: "keep_source", reasons: ["It broke."], advice: ["Try “a van”."] });
  const earlier = await client.verdict("job_1");
  assert.equal(earlier?.value, "doubtful");
  assert.match(earlier?.reasons[0] ?? "", /^An earlier version/);
  assert.equal(await client.verdict("job_1"), null);
  assert.deepEqual(asked.map(({ url }) => url), Array(3).fill(`${BASE}v1/jobs/job_1/artifacts/report.json`));
});
