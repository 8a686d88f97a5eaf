// @ts-check
/**
 * To what shape an asset was fitted and how near it came, in words. No elements here, so that node can test it.
 *
 * @typedef {object} Fit What `report.json` says of one, as far as it is said here.
 * @property {string} [words] The shape, such as "a giraffe, standing".
 * @property {boolean} [twin] Whether the asset was what was asked for, and was changed as two such shapes differ.
 * @property {number} [distance_before] Mean distance from the shape, as a share of the diagonal.
 * @property {number} [distance]
 * @property {number} [kept] Share of the move that was left when folds and cuts were mended.
 * @property {string[]} [left_over] Parts that only the asset has.
 * @property {string[]} [missing] Parts that only the shape has.
 */
import { percent } from "./format.js";

// So much of a move is kept wherever hardly anything has to be mended.
const WHOLE = 0.95;

/** Those that a report tells of; none where the asset was not fitted. @param {any} report @returns {Fit[]} */
export function fitsOf(report) {
  return [report?.exemplar ?? []].flat();
}

/** @param {any} report @returns {import("./quality.js").Finding[]} */
export function fitFindings(report) {
  return fitsOf(report).map((fit) => {
    const text = fit.twin ? `Changed as one shape of ${fit.words} differs from another` : `Fitted to ${fitWords(fit)}`;
    return { tone: "plain", text, note: fitNotes(fit) };
  });
}

/** The shape, and how near the asset came to it. @param {Fit} fit */
export function fitWords({ words = "a shape", distance_before: before, distance }) {
  const known = typeof before === "number" && typeof distance === "number" && before > 0;
  return known ? `${words}: ${percent(1 - distance / before)} of the way` : words;
}

/** @param {Fit} fit */
function fitNotes({ kept, left_over: left = [], missing = [] }) {
  return [
    left.length ? `Only your asset has: ${left.join(", ")}.` : "",
    missing.length ? `Only that shape has: ${missing.join(", ")}.` : "",
    typeof kept === "number" && kept < WHOLE ? `So that nothing folds or cuts, ${percent(1 - kept)} of the move was taken back.` : "",
  ].filter(Boolean).join(" ");
}
