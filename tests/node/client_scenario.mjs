// Uses the TypeScript client as a program does: node client_scenario.mjs MODULE URL BROKEN_URL ASSET
import { readFile } from "node:fs/promises";

const [module, url, brokenUrl, path] = process.argv.slice(2);
const { Client, MeshdeformError, isTerminal } = await import(module);
const asset = new File([await readFile(path)], "sphere.glb");
const request = { prompt: "a mushroom", params: { preset: "preview", steps: 12 }, metadata: { shot: "sc010" } };

/** The error of a promise that fails. */
async function failure(promise) {
  try {
    await promise;
  } catch (error) {
    return { ours: error instanceof MeshdeformError, code: error.code, status: error.status, name: error.name, advice: error.advice };
  }
  return null;
}

// The answer to the first request of each POST is lost on the way.
const lost = new Set();
const posts = [];
const client = new Client({
  baseUrl: url,
  async fetch(input, init) {
    const response = await fetch(input, init);
    if (init.method !== "POST") return response;
    posts.push(new URL(input).pathname);
    if (!lost.has(input)) {
      lost.add(input);
      throw new TypeError("the line broke");
    }
    return response;
  },
});
const checked = await client.validate(asset, request);
const posted = await client.submit(asset, request);
const events = [];
const job = await client.wait(posted, { onEvent: (event) => events.push(event) });
const progress = [];
const uploaded = await client.upload(asset, { onProgress: (bytes) => progress.push(bytes) });
const known = await client.submit(uploaded, { ...request, prompt: "a vase" }, { idempotencyKey: "take-3" });
const again = await client.submit(uploaded, { ...request, prompt: "a vase" }, { idempotencyKey: "take-3" });
await client.wait(again);

// Through a line that breaks again and again.
const broken = [];
for await (const event of new Client({ baseUrl: brokenUrl }).watch(job)) broken.push(event.seq);
const later = [];
for await (const event of client.watch(job, { after: events.length - 1 })) later.push(event.type);

const fromUpload = await client.deform(uploaded, request);
const listed = [];
for await (const each of client.jobs({ search: "mushroom", metadata: { shot: "sc010" } })) listed.push(each.id);
const signed = await client.signedUrl(job);

const canceled = await client.submit(uploaded, { ...request, prompt: "a vase", params: { steps: 5000 } });
await failure(client.wait(await client.cancel(canceled)));
const longer = await client.retry(canceled, { maxRunS: 7200 });
await client.cancel(longer);

const retired = await failure(client.submit(null, { kind: "prior_teach" }, { files: { meshes: asset } }));

const left = new AbortController();
const abandoned = failure(client.wait(`job_${"0".repeat(26)}`, { signal: left.signal }));
left.abort();
await client.delete(known);
console.log(
  JSON.stringify({
    vertices: checked.asset.vertices,
    job: job.id,
    posts,
    seqs: events.map((event) => event.seq),
    ended: isTerminal(events.at(-1).type),
    sameJob: known.id === again.id,
    broken,
    later,
    progress,
    uploadState: uploaded.state,
    fromUpload: fromUpload.state,
    listed: [listed.includes(job.id), listed.includes(known.id), listed.includes(fromUpload.id)],
    result: await (await client.download(job)).text(),
    artifacts: (await client.artifacts(job)).map((artifact) => artifact.name),
    sent: (await client.file(job)).size,
    longer: [longer.origin.job_id === canceled.id, longer.max_run_s],
    signed: (await (await fetch(signed.url)).blob()).size > 0,
    retired,
    missing: await failure(client.get(`job_${"0".repeat(26)}`)),
    deleted: await failure(client.get(known)),
    refused: await failure(client.submit(asset, { prompt: "a quixotic zeitgeist" })),
    nobody: await failure(new Client({ baseUrl: "http://127.0.0.1:9", maxRetries: 0 }).models()),
    abandoned: await abandoned,
    models: (await client.models()).models.length > 0,
    limits: (await client.limits()).kinds.map((kind) => kind.name),
  }),
);
