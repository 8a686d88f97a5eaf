import { createHash } from "node:crypto";
import { readFile } from "node:fs/promises";
import { NodeIO } from "@gltf-transform/core";
import { ALL_EXTENSIONS } from "@gltf-transform/extensions";
import { dedup, meshopt, prune } from "@gltf-transform/functions";
import draco3d from "draco3dgltf";
import { MeshoptDecoder, MeshoptEncoder } from "meshoptimizer";

const service = process.env.MESHDEFORM_URL ?? "http://127.0.0.1:8765";
const key = process.env.MESHDEFORM_API_KEY;

async function call(path, { headers, ...options } = {}) {
  const authorization = key ? { Authorization: `Bearer ${key}` } : {};
  for (let left = 5; ; left -= 1) {
    const answer = await fetch(service + path, { ...options, headers: { ...authorization, ...headers } }).catch((error) => error);
    if (answer.ok) return answer;
    const again = answer instanceof Error || answer.status === 429 || answer.status >= 500;
    if (!again || left === 0) throw answer instanceof Error ? answer : new Error(await answer.text());
    const pause = answer instanceof Error ? 1 : Number(answer.headers.get("Retry-After") ?? 1);
    await new Promise((resolve) => setTimeout(resolve, 1000 * pause));
  }
}

async function deform(glb, request) {
  const form = new FormData();
  form.append("request", request);
  form.append("asset", new Blob([glb]), "asset.glb");
  // Sent again after a broken connection, it stays one job.
  const once = createHash("sha256").update(request).update(glb).digest("hex");
  let job = await (await call("/v1/jobs", { method: "POST", body: form, headers: { "Idempotency-Key": once } })).json();
  while (["queued", "running", "canceling"].includes(job.state)) {
    job = await (await call(`/v1/jobs/${job.id}`, { headers: { Prefer: "wait=60" } })).json();
  }
  if (job.state !== "succeeded") throw new Error(`${job.id} ${job.state}: ${job.error?.detail} ${job.error?.advice}`);
  return new Uint8Array(await (await call(`/v1/jobs/${job.id}/artifacts/result.glb`)).arrayBuffer());
}

const io = new NodeIO().registerExtensions(ALL_EXTENSIONS).registerDependencies({
  "draco3d.decoder": await draco3d.createDecoderModule(),
  "meshopt.decoder": MeshoptDecoder,
  "meshopt.encoder": MeshoptEncoder,
});
const [input, output] = process.argv.slice(2);
const source = await io.read(input);
await source.transform(dedup(), prune());
const result = await io.readBinary(await deform(await io.writeBinary(source), await readFile("request.json", "utf8")));
await result.transform(meshopt({ encoder: MeshoptEncoder }));
await io.write(output, result);
