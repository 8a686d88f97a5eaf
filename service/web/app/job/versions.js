// @ts-check
/** The versions of an asset as a thread: the jobs that went on from a job's result, from one of its steps, or from its settings. */
import { client } from "../client.js";
import { goalWords, jobTitle } from "../format.js";
import { routeHash } from "../router.js";

const LISTED = 100;

/** The label `thread` of a job that goes on from this one. @param {any} job */
export function threadOf(job) {
  return String(job.metadata?.thread ?? job.id);
}

/** The results of the other versions, oldest first: each leads to its page. @param {any} job @param {AbortSignal} signal @returns {Promise<import("../create/live.js").Shape[]>} */
export async function versionShapes(job, signal) {
  const thread = threadOf(job);
  const { jobs } = await client.jobPage({ metadata: { thread }, limit: LISTED, signal });
  const first = jobs.some((found) => found.id === thread) || thread === job.id ? null : await client.get(thread, signal).catch(() => null);
  const others = [...(first ? [first] : []), ...[...jobs].reverse()].filter((found) => found.id !== job.id && found.state === "succeeded");
  return others.map((found) => resultShape(found, signal));
}

/** The result of another job, which leads to its page. @param {any} job @param {AbortSignal} signal @returns {import("../create/live.js").Shape} */
export function resultShape(job, signal) {
  const path = `v1/jobs/${job.id}/artifacts/result.glb`;
  return { key: path, label: goalWords(job) || jobTitle(job), load: () => client.bytes(path, { signal }), strength: 1, tag: "Result", href: routeHash({ name: "job", id: job.id }) };
}
