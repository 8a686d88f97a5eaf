// @ts-check
/**
 * To what shape an asset was fitted and how near it came, in words. No elements here, so that node can test it.
 *
 * @typedef {object} Fit An entry of `exemplars` in `report.json`, as far as it is said here.
 * @property {{noun?: string, form?: string, pose?: string, attributes?: string[], way?: string}} [member] The shape. `way`: "mould",
 *   of an asset without parts, or else how it was fitted.
 * @property {string | null} [target] The part with the target mesh that was taken.
 * @property {number} [kept] Share of the way that was left when folds and cuts were mended.
 * @property {number} [distance_before] Mean distance from the shape, as a share of the diagonal.
 * @property {number} [distance]
 * @property {string[]} [left_over] Parts that only the asset has.
 * @property {string[]} [missing] Parts that only the shape has.
 */
import { figure, percent } from "./format.js";
import { withArticle } from "./vocabulary.js";

/** Those that a report tells of; none where the asset was not fitted. @param {any} report @returns {Fit[]} */
export function fitsOf(report) {
  return Array.isArray(report?.exemplars) ? report.exemplars : [];
}

/** @param {any} report @param {Record<string, {filename: string}>} files Of the job, by the names of their parts. @returns {import("./quality.js").Finding[]} */
export function fitFindings(report, files) {
  return fitsOf(report).map((fit) => {
    return { tone: "plain", text: `${fit.member?.way === "mould" ? "Moulded into" : "Fitted to"} ${fitWords(fit, files)}`, note: fitNotes(fit) };
  });
}

/** The shape, and how far the asset went towards it. @param {Fit} fit @param {Record<string, {filename: string}>} [files] */
export function fitWords({ target, member, kept }, files = {}) {
  const words = target ? (files[target]?.filename ?? "a target mesh") : memberWords(member ?? {});
  return typeof kept === "number" ? `${words}: ${percent(kept)} of the way` : words;
}

/** "a fat giraffe, lying". @param {NonNullable<Fit["member"]>} member */
function memberWords({ noun = "shape", form = noun, pose, attributes = [] }) {
  const kind = form.replaceAll("-", " ");
  const named = kind.endsWith(noun) ? kind : noun;
  // Those of parts are two words.
  const words = withArticle([...attributes.filter((each) => !each.includes(" ")), named].join(" "));
  return pose ? `${words}, ${POSES[pose] ?? pose}` : words;
}

const POSES = /** @type {Record<string, string>} */ ({ folded: "wings folded", spread: "wings spread" });

/** @param {number} value */
function rough(value) {
  return Number(value.toPrecision(2));
}

/** @param {Fit} fit */
function fitNotes({ distance_before: before, distance, left_over: left = [], missing = [] }) {
  const known = typeof before === "number" && typeof distance === "number";
  return [
    known ? `On average ${figure(rough(100 * distance))}% of its size from it, ${figure(rough(100 * before))}% before.` : "",
    left.length ? `Only your asset has: ${[...new Set(left)].join(", ")}.` : "",
    missing.length ? `Only that shape has: ${[...new Set(missing)].join(", ")}.` : "",
  ].filter(Boolean).join(" ");
}
