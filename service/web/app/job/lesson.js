// @ts-check
/** What a lesson has taught, in words, and the way to use it. */
import { h, panel } from "../dom.js";
import { currentLink } from "../key.js";
import { routeHash } from "../router.js";
import { withArticle } from "../vocabulary.js";
import { findingList } from "./results.js";

/** @param {any} job */
export function isLesson(job) {
  return job.kind === "prior_teach";
}

/** What the report of a lesson says, in sentences. @param {any} report @returns {import("../quality.js").Finding[]} */
export function lessonFindings(report) {
  const { new: learned, old_before: before, old_after: after } = report.retrieval;
  const word = withArticle(report.noun);
  return [
    { tone: learned.share >= 0.75 ? "good" : "warn", text: `${learned.hits} of ${learned.pictures} pictures that it had not seen look like ${word} to the model`, note: "Held-out pictures of your meshes" },
    { tone: after.hits >= before.hits - 2 ? "good" : "warn", text: `${after.hits} of ${after.pictures} old words that were tried are still known`, note: `Before the lesson: ${before.hits}` },
    { tone: "plain", text: `The weights of step ${report.steps.best} are kept`, note: report.stopped_early ? `Stopped after ${report.steps.done} steps, as more did not help` : `${report.steps.done} steps` },
    ...report.warnings.map((/** @type {string} */ text) => ({ tone: /** @type {const} */ ("warn"), text, note: "" })),
  ];
}

/** @param {any} job @param {any} report */
export function lessonPanel(job, report) {
  const prompt = withArticle(report.noun);
  return panel(
    "lesson-title",
    "What it learned",
    findingList(lessonFindings(report)),
    // Who came by a link makes no jobs.
    currentLink() ? null : h("p", null, h("a", { class: "button button-primary", href: routeHash({ name: "create", from: null, model: `job:${job.id}`, prompt }) }, `Use “${prompt}”`)),
  );
}
