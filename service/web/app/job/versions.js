// @ts-check
/** The versions of an asset as a thread: the jobs that went on from a job's result, from one of its steps, or from its settings. */
import { client, isAbort } from "../client.js";
import { button, fill, h, panel } from "../dom.js";
import { ago, goalWords, jobTitle } from "../format.js";
import { routeHash } from "../router.js";
import { stateBadge } from "../jobs/card.js";

const LISTED = 100;

/** The label `thread` of a job that goes on from this one. @param {any} job */
export function threadOf(job) {
  return String(job.metadata?.thread ?? job.id);
}

/** The version that a job began with; undefined: the asset as it was sent. @param {any} job @param {any[]} versions */
export function before(job, versions) {
  const result = (/** @type {any} */ each) => each.artifacts?.find((/** @type {any} */ found) => found.name === "result.glb")?.sha256;
  return versions.find((each) => each.id === job.origin?.job_id || (each.id !== job.id && result(each) === job.asset.sha256));
}

/** @param {any} job @param {import("../scope.js").Scope} scope */
export function versionsPanel(job, scope) {
  const list = h("ol", { class: "files" });
  const element = panel("versions-title", "Versions", list);
  element.hidden = true;
  load(job, element, list, scope).catch((error) => isAbort(error) || console.warn(error));
  return element;
}

/** @param {any} job @param {HTMLElement} element @param {HTMLElement} list @param {import("../scope.js").Scope} scope */
async function load(job, element, list, scope) {
  const thread = threadOf(job);
  const { jobs } = await client.jobPage({ metadata: { thread }, limit: LISTED, signal: scope.signal });
  const first = jobs.some((found) => found.id === thread) ? null : await client.get(thread, scope.signal).catch(() => null);
  const versions = [...(first ? [first] : []), ...[...jobs].reverse()];
  if (versions.length < 2) return;
  const previous = before(job, versions);
  fill(
    list,
    versions.map((version) => row(version, job, before(version, versions))),
    previous ? h("li", { class: "row" }, h("a", { class: "button", href: routeHash({ name: "job", id: previous.id }) }, "Undo: back to the version before")) : null,
  );
  element.hidden = false;
}

/** @param {any} version @param {any} job @param {any} previous */
function row(version, job, previous) {
  const here = version.id === job.id;
  const goal = goalWords(version);
  const title = goal ? `“${goal}”` : jobTitle(version);
  const from = previous ? `after “${goalWords(previous) || jobTitle(previous)}”` : `from ${version.asset.filename}`;
  return h(
    "li",
    { class: "file", "aria-current": here ? "true" : null },
    h("div", null, h("strong", null, here ? title : h("a", { href: routeHash({ name: "job", id: version.id }) }, title)), h("span", { class: "small muted" }, `${from} · ${ago(version.created_at)}${here ? " · this one" : ""}`)),
    h("div", { class: "row" }, version.state !== "succeeded" ? stateBadge(version.state) : here || job.state !== "succeeded" ? null : comparison(version, job)),
  );
}

/** @param {any} version @param {any} job */
function comparison(version, job) {
  const title = `Compare with ${jobTitle(version)}`;
  const go = () => void (location.hash = routeHash({ name: "compare", ids: [version.id, job.id] }));
  return button(title, go, { icon: "grid", quiet: true, class: "button-quiet" });
}
