// @ts-check
/** What a form begins with: the files and the settings of a job, or of one of the examples. */
import { Asset, exampleAsset } from "../assets.js";
import { client } from "../client.js";
import { exampleOf } from "../examples/gallery.js";
import { continued } from "../params.js";

const EXAMPLE = "example:";
const RESULT = "result:";

/** What a form begins with that begins with an example. @param {string} id */
export function exampleOrigin(id) {
  return EXAMPLE + id;
}

/** What a form begins with that begins with the result of a job, and no settings. @param {string} id */
export function resultOrigin(id) {
  return RESULT + id;
}

/**
 * @typedef {object} Origin
 * @property {any} job The document of the job, or as much of one as an example has.
 * @property {Asset} asset
 * @property {Record<string, Asset>} others Its files besides the asset, by their names in the job.
 * @property {string} [result] What an example became, a file below `web/examples/`.
 */

/** @param {string} from The id of a job, or what `exampleOrigin` or `resultOrigin` returns. @param {AbortSignal} signal @returns {Promise<Origin>} */
export async function originOf(from, signal) {
  if (from.startsWith(EXAMPLE)) return beginOf(from.slice(EXAMPLE.length), signal);
  const job = await client.get(from.startsWith(RESULT) ? from.slice(RESULT.length) : from, signal);
  if (from.startsWith(RESULT)) {
    const name = job.asset.filename.replace(/\.[^.]*$/, "") + ".glb";
    return { job: continued(job), asset: new Asset(await client.download(job, "result.glb", { signal }), name), others: {} };
  }
  const asset = new Asset(await client.file(from, "asset", signal), job.asset.filename);
  // The model names its weights.
  const named = Object.entries(job.files ?? {}).filter(([name]) => !["asset", "weights"].includes(name));
  const files = named.map(async ([name, { filename }]) => [name, new Asset(await client.file(from, name, signal), filename)]);
  return { job, asset, others: Object.fromEntries(await Promise.all(files)) };
}

/** @param {string} id @param {AbortSignal} signal @returns {Promise<Origin>} */
async function beginOf(id, signal) {
  const example = await exampleOf(id, signal);
  const asset = await exampleAsset(example.asset, signal);
  return { job: { ...example.document, asset: { filename: asset.name, size: asset.size } }, asset, others: {}, result: example.result };
}
