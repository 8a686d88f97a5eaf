// @ts-check
/** What a job deforms: its asset. Earlier editions fitted a mesh to points, distance grids and networks first. */
import { Asset, FORMATS, formatOf } from "../assets.js";
import { client } from "../client.js";

const FITTED = "source.glb";

/**
 * @param {any} job
 * @param {import("../scope.js").Scope} scope
 * @returns {Promise<{buffer: ArrayBuffer, format: string}>} The file whose triangles the result has.
 */
export async function sourceOf(job, scope) {
  const options = { signal: scope.signal };
  const buffer = await client.bytes(`v1/jobs/${job.id}/asset`, options);
  const asset = new Asset(new Blob([buffer]), job.asset.filename);
  // A file without a known ending is a GLB.
  if (!asset.format || (await asset.drawn())) return { buffer, format: formatOf(job.asset.filename, FORMATS) || "glb" };
  return { buffer: await client.bytes(`v1/jobs/${job.id}/artifacts/${FITTED}`, options), format: "glb" };
}
