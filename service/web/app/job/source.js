// @ts-check
/** What a job deforms: its asset, or the mesh that its worker first fits to points, a distance grid or a network. */
import { Asset, formatOf, SURFACE_FORMATS } from "../assets.js";
import { client } from "../client.js";
import { isTerminal } from "../history.js";

const FITTED = "source.glb";
const AGAIN_MS = 2000;

/**
 * @param {any} job
 * @param {import("../scope.js").Scope} scope
 * @param {() => void} onWait Called before each wait for a mesh that is still to be fitted.
 * @returns {Promise<{buffer: ArrayBuffer, format: string}>} The file whose triangles the result has.
 */
export async function sourceOf(job, scope, onWait) {
  const options = { signal: scope.signal };
  const format = formatOf(job.asset.filename, SURFACE_FORMATS) || "glb";
  if (formatOf(job.asset.filename) || format === "glb") {
    const buffer = await client.bytes(`v1/jobs/${job.id}/asset`, options);
    // A PLY may hold points.
    if (format !== "ply" || (await new Asset(new Blob([buffer]), job.asset.filename).drawn())) return { buffer, format };
  }
  for (;;) {
    // In this order: what a job has when it is over, it keeps.
    const { state } = await client.get(job.id, scope.signal);
    const artifacts = await client.artifacts(job.id, scope.signal);
    if (artifacts.some(({ name }) => name === FITTED)) {
      return { buffer: await client.bytes(`v1/jobs/${job.id}/artifacts/${FITTED}`, options), format: "glb" };
    }
    if (isTerminal(state)) throw new Error("It has no triangles, and the job ended before a mesh was fitted to it.");
    onWait();
    if (!(await scope.sleep(AGAIN_MS))) throw new DOMException("The page was left.", "AbortError");
  }
}
