// @ts-check
/** How long a job would take, in words. */
import { duration, roughly } from "../format.js";

/**
 * @param {any} found What `POST /v1/jobs:validate` says.
 * @param {number} variations
 */
export function estimateWords(found, variations) {
  const { queue_s: queue, run_s: run } = found.estimate;
  const steps = `${found.params.steps.toLocaleString("en")} steps`;
  if (run === null) return `${steps}. No estimate yet: no job like this has run here.`;
  const all = run * variations;
  const wait = queue && queue > 1 ? `, after about ${duration(Math.round(queue))} in the queue` : "";
  return `${steps}, about ${roughly(all)}${variations > 1 ? " for all, with one worker" : ""}${wait}.`;
}
