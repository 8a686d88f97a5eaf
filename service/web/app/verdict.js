// @ts-check
/** What a result is worth, by its report: first on cards and pages, with what helps where it is not good. */
import { readVerdict } from "../client/index.js";
import { h, icon } from "./dom.js";

/** @typedef {import("../client/index.js").Verdict} Verdict */

const SHOWN = /** @type {Record<string, {title: string, glyph: string}>} */ ({
  good: { title: "Good", glyph: "check" },
  doubtful: { title: "Doubtful", glyph: "info" },
  keep_source: { title: "Better keep your asset", glyph: "warn" },
});

/** @param {Verdict} verdict */
export function verdictBadge({ value }) {
  const { title, glyph } = SHOWN[value] ?? SHOWN.doubtful;
  return h("span", { class: `badge badge-${value}` }, icon(glyph), title);
}

/** Its verdict in words, first of all that a report says. @param {any} report @returns {import("./quality.js").Finding[]} */
export function verdictFinding(report) {
  const verdict = readVerdict(report);
  if (!verdict) return [];
  const { title } = SHOWN[verdict.value];
  const note = verdict.reasons.join(" ");
  return [{ tone: verdict.value === "good" ? "good" : "warn", text: title, note }];
}

/** Its verdict in a word or two; null where it has none. @param {any} report */
export function verdictTitle(report) {
  const verdict = readVerdict(report);
  return verdict && SHOWN[verdict.value].title;
}

/** Whether a report says that its result is not good. @param {any} report */
export function isWorthLess(report) {
  return (readVerdict(report)?.value ?? "good") !== "good";
}

/** What may help, in sentences; null where nothing needs help. @param {any} report */
export function adviceList(report) {
  const advice = readVerdict(report)?.advice ?? [];
  return advice.length ? h("ul", { class: "advice" }, advice.map((text) => h("li", null, text))) : null;
}
