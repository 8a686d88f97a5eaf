// @ts-check
/** The newest jobs, below the form for a new one. */
import { client } from "../client.js";
import { fill, h } from "../dom.js";
import { JobCard } from "./card.js";

/** @param {import("../scope.js").Scope} scope */
export function recentJobs(scope) {
  const element = h("section", { class: "recent", "aria-labelledby": "recent-title", hidden: true });
  client.jobPage({ limit: 6, signal: scope.signal }).then(
    ({ jobs }) => {
      if (!jobs.length || scope.over) return;
      element.hidden = false;
      fill(
        element,
        h("div", { class: "section-head" }, h("h2", { id: "recent-title" }, "Recent jobs"), h("a", { href: "#/jobs" }, "All jobs")),
        h("ul", { class: "card-grid" }, jobs.map((/** @type {any} */ job) => new JobCard(job, scope, { level: "h3" }).element)),
      );
    },
    () => {}, // The form works without them.
  );
  return element;
}
