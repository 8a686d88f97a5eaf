// @ts-check
/** What a result is worth, by its report: first on cards and pages, with what helps where it is not good. */
import { readVerdict } from "../client/index.js";
import { h, icon } from "./dom.js";
import { plainWords } from "./plain.js";

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

/** A verdict and why, and what may help, in sentences. @param {Verdict} verdict @returns {HTMLElement[]} */
export function verdictWords({ value, reasons, advice }) {
  const { title } = SHOWN[value] ?? SHOWN.doubtful;
  const why = reasons.map(plainWords).filter(Boolean).join(" ");
  const help = value === "good" ? [] : advice.map(plainWords).filter(Boolean);
  return [h("p", null, h("strong", null, `${title}.`), why && ` ${why}`), ...(help.length ? [h("ul", { class: "advice" }, help.map((text) => h("li", null, text)))] : [])];
}

/** Whether a report says that its result is not good. @param {any} report */
export function isWorthLess(report) {
  return (readVerdict(report)?.value ?? "good") !== "good";
}
