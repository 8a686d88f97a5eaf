// @ts-check
/**
 * What two jobs have in common and what not: their requests, and the figures of their results. No elements here, so that
 * node can test it.
 *
 * @typedef {{label: string, values: [string, string], same: boolean}} Row
 */
import { controlOf, controlWords, promptWords } from "../create/control/model.js";
import { targetsOf } from "../create/guide/model.js";
import { fitsOf, fitWords } from "../exemplar.js";
import { count, duration, figure, goalWords, percent, STATE_WORDS } from "../format.js";
import { plainParams } from "../groups.js";
import { isTerminal } from "../history.js";
import { isByShape, qualityWords } from "../params.js";
import { shownQuality } from "../quality.js";
import { isWorthLess, verdictTitle } from "../verdict.js";

// Said in rows of their own, or without a bearing on the result.
const SAID = ["preset", "seed", "model", "prompts", "regions", "handles", "symmetry", "parts", "source_noun", "checkpoint_every_steps"];

/** @param {string} label @param {string} a @param {string} b @returns {Row} */
function row(label, a, b) {
  return { label, values: [a, b], same: a === b };
}

/** Why a job has nothing to compare; empty where it has. @param {any} job */
export function obstacle(job) {
  if ((job.kind ?? "text_deform") !== "text_deform") return "This job does not deform an asset, so it has no shape to compare.";
  if (job.state === "succeeded") return "";
  if (!isTerminal(job.state)) return "This job has not finished yet.";
  return `This job has no result: ${STATE_WORDS[job.state].toLowerCase()}.`;
}

/**
 * What was asked of two jobs: that which tells jobs apart always, the other parameters where they differ.
 * @param {[any, any]} jobs
 * @param {[any, any]} reports `report.json` of each; null where there is none.
 * @returns {Row[]}
 */
export function askedRows(jobs, reports) {
  const both = (/** @type {(job: any, report: any) => string} */ say) => /** @type {[string, string]} */ ([0, 1].map((i) => say(jobs[i], reports[i])));
  const asked = jobs.map((job) => plainParams(job.params));
  const control = asked.map((params) => [...promptWords(params.prompts ?? []), ...controlWords(controlOf(params))].join("; "));
  const always = [
    row("Prompt", ...both(goalWords)),
    row("Asset", ...both((job) => job.asset.filename)),
    row("Quality", ...both(qualityWords)),
    row("Variation", ...both((job) => String(job.params?.seed ?? 0))),
    row("Model", ...both((job, report) => (isByShape(job) ? "" : String(report?.params?.model ?? plainParams(job.params).model ?? "builtin")))),
    row("Control", control[0], control[1]),
    row("Target", ...both((job) => targetsOf(job.files ?? {}).map(({ filename }) => filename).join(", "))),
  ];
  // What the presets decided differs too; a job without a report has only what was written.
  const params = reports.every((report) => report?.params) ? reports.map((report) => report.params) : asked;
  const names = [...new Set(params.flatMap((found) => Object.keys(found)))].filter((name) => !SAID.includes(name));
  const others = names.map((name) => row(name, valueText(params[0][name]), valueText(params[1][name])));
  const outputs = [...new Set(jobs.flatMap((job) => Object.keys(job.output ?? {})))].map((name) => row(`output.${name}`, valueText(jobs[0].output?.[name]), valueText(jobs[1].output?.[name])));
  return [...always.filter(({ values }) => values.some(Boolean)), ...[...others, ...outputs].filter(({ same }) => !same)];
}

/** @param {unknown} value */
function valueText(value) {
  if (value === undefined || value === null || value === "") return "";
  if (typeof value === "number") return String(Number(value.toPrecision(8)));
  return typeof value === "object" ? JSON.stringify(value) : String(value);
}

/** The figures of two results, side by side; those that neither report has are left out. @param {[any, any]} reports @returns {Row[]} */
export function figureRows(reports) {
  const take = (/** @type {string} */ label, /** @type {(report: any) => unknown} */ get, /** @type {(value: any) => string} */ say = figure) => {
    const [a, b] = reports.map((report) => get(report ?? {}) ?? null);
    const text = (/** @type {unknown} */ value) => (value === null ? "" : say(value));
    return row(label, text(a), text(b));
  };
  const seconds = (/** @type {any} */ report) => report.seconds && Object.values(report.seconds).reduce((sum, each) => sum + each, 0);
  return [
    take("Verdict", verdictTitle, String),
    take("Fitted to", (report) => fitsOf(report).map((fit) => fitWords(fit)).join("; ") || null, String),
    take("Looks like", ({ likeness }) => (likeness?.noun && typeof likeness.probability === "number" ? likeness : null), ({ noun, probability }) => `${noun} ${percent(probability)}`),
    take("Still your asset", (report) => (isWorthLess(report) ? null : shownQuality(report).kept_share), percent),
    take("Flipped faces", (report) => shownQuality(report).flipped_faces, count),
    take("Self-intersecting faces", (report) => shownQuality(report).self_intersecting_faces_after, count),
    take("Collapsed faces", (report) => shownQuality(report).collapsed_faces, count),
    take("Distortion, 99th percentile", (report) => shownQuality(report).symmetric_dirichlet_p99),
    take("Sharpest corners", (report) => shownQuality(report).min_angle_p1_deg_after, (value) => `${figure(value)}°`),
    take("Texture stretch, 95th percentile", ({ texture_stretch: stretch }) => stretch?.p95, (value) => `${figure(value)}×`),
    take("Surface", (report) => shownQuality(report).area_ratio, (value) => `${figure(value)}×`),
    take("Volume", (report) => shownQuality(report).volume_ratio, (value) => `${figure(value)}×`),
    take("Moved, root mean square", ({ movement }) => movement?.rms, (value) => `${figure(100 * value)}%`),
    take("Triangles", ({ mesh }) => mesh?.source_triangles, count),
    take("Steps", ({ params, way }) => (["exemplar", "change"].includes(way) ? null : params?.steps), count),
    take("Time", seconds, duration),
  ].filter(({ values }) => values.some(Boolean));
}
