// Posts a job with generated types and openapi-fetch, polls it, and downloads its results.
import createClient from "openapi-fetch";
import type { components, paths } from "./api.js";

type Job = components["schemas"]["JobView"];

/** Write a body as a form: files as they are, documents as JSON. */
function form(body: Record<string, unknown>): FormData {
  const parts = new FormData();
  for (const [name, value] of Object.entries(body)) {
    parts.append(name, value instanceof Blob ? value : new Blob([JSON.stringify(value)], { type: "application/json" }));
  }
  return parts;
}

function value<T>(answer: { data?: T; error?: components["schemas"]["Problem"] }): T {
  if (answer.data === undefined) {
    throw new Error(answer.error ? `${answer.error.code}: ${answer.error.detail}` : "no body");
  }
  return answer.data;
}

export async function run(baseUrl: string, asset: Blob): Promise<Record<string, unknown>> {
  const client = createClient<paths>({ baseUrl });
  const request = { prompt: "a mushroom", params: { preset: "preview", steps: 12 } } as const;
  const body = { asset: new File([asset], "sphere.glb"), request };
  const found = value(await client.POST("/v1/jobs:validate", { body, bodySerializer: form }));
  let job: Job = value(await client.POST("/v1/jobs", { body, bodySerializer: form }));
  while (job.finished_at === null || job.finished_at === undefined) {
    const headers = { prefer: "wait=10" };
    job = value(await client.GET("/v1/jobs/{id}", { params: { path: { id: job.id }, header: headers } }));
  }
  const files: Record<string, string> = {};
  const { artifacts } = value(await client.GET("/v1/jobs/{id}/artifacts", { params: { path: { id: job.id } } }));
  for (const { name } of artifacts) {
    const path = { id: job.id, name };
    const bytes = await client.GET("/v1/jobs/{id}/artifacts/{name}", { params: { path }, parseAs: "blob" });
    files[name] = await value(bytes).text();
  }
  const sent = await client.GET("/v1/jobs/{id}/asset", { params: { path: { id: job.id } }, parseAs: "blob" });
  const missing = await client.GET("/v1/jobs/{id}", { params: { path: { id: `job_${"0".repeat(26)}` } } });
  const code = missing.error?.code;
  return { vertices: found.asset.vertices, state: job.state, files, assetSize: value(sent).size, code };
}
