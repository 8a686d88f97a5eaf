// @ts-check
/** The variations that a job is one of, as a strip to choose from. */
import { client, isAbort } from "../client.js";
import { fill, h } from "../dom.js";
import { jobTitle } from "../format.js";
import { JobCard } from "../jobs/card.js";

const MOST = 24;

/** @param {any} job @param {HTMLElement} element @param {import("../scope.js").Scope} scope */
export async function showVariations(job, element, scope) {
  const { group } = job.metadata ?? {};
  if (!group) return;
  try {
    const { jobs } = await client.jobPage({ metadata: { group }, limit: MOST, signal: scope.signal });
    const variations = [...jobs].reverse();
    if (scope.over || variations.length < 2) return;
    const cards = variations.map((each) => {
      const { element: card, title } = new JobCard(each, scope, { level: "h3", heading: jobTitle(each) });
      if (each.id === job.id) title.setAttribute("aria-current", "page");
      return card;
    });
    fill(element, h("ul", { class: "strip" }, cards));
    element.hidden = false;
    element.querySelector("[aria-current]")?.closest("li")?.scrollIntoView({ block: "nearest", inline: "nearest" });
  } catch (error) {
    if (!isAbort(error)) console.warn(error);
  }
}
