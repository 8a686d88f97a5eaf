// @ts-check
/** Choose the job that another one is compared with. */
import { client, isAbort } from "../client.js";
import { isDeleted } from "../deletions.js";
import { ask } from "../dialogs.js";
import { fill, h } from "../dom.js";
import { ago, jobTitle } from "../format.js";
import { isDeformation } from "../job/shapes.js";
import { described } from "../problem-box.js";
import { MAX_SEARCH, routeHash } from "../router.js";
import { debounced } from "../scope.js";

const LISTED = 100;

/** Ask for another job with a result, and go to the comparison. @param {any} job @param {import("../scope.js").Scope} scope */
export function compareWith(job, scope) {
  const search = h("input", { type: "search", id: "compare-search", maxlength: MAX_SEARCH, placeholder: "Prompt, file or label", autocomplete: "off" });
  const other = h("select", { id: "compare-other" });
  const note = h("p", { class: "small muted", role: "status" });
  let asked = 0;
  const find = async () => {
    const turn = ++asked;
    try {
      const { jobs } = await client.jobPage({ state: "succeeded", limit: LISTED, search: search.value.trim(), signal: scope.signal });
      if (turn === asked) offer(jobs.filter((/** @type {any} */ each) => each.id !== job.id && isDeformation(each) && !isDeleted(each.id)));
    } catch (error) {
      if (!isAbort(error) && turn === asked) note.textContent = described(error).title;
    }
  };
  const offer = (/** @type {any[]} */ jobs) => {
    const option = (/** @type {any} */ each) => h("option", { value: each.id }, `${jobTitle(each)} · ${each.asset.filename} · variation ${each.params?.seed ?? 0} · ${ago(each.created_at)}`);
    const near = jobs.filter((each) => each.asset.sha256 === job.asset.sha256);
    const far = jobs.filter((each) => !near.includes(each));
    const group = (/** @type {string} */ label, /** @type {any[]} */ list) => (list.length ? h("optgroup", { label }, list.map(option)) : null);
    fill(other, group("The same asset", near), group("Other assets", far));
    other.disabled = !jobs.length;
    note.textContent = jobs.length ? "" : search.value.trim() ? "No finished job matches." : "There is no other finished job yet.";
  };
  const later = debounced(find, 250, scope);
  search.addEventListener("input", later);
  ask(
    {
      title: "Compare with",
      body: [
        h("label", { class: "field-label", for: "compare-search" }, "Search"),
        search,
        h("label", { class: "field-label", for: "compare-other" }, "Job"),
        other,
        note,
      ],
      action: "Compare",
      act: async () => {
        if (!other.value) throw new Error("Choose a job first.");
        location.hash = routeHash({ name: "compare", ids: [job.id, other.value] });
      },
    },
    scope,
  );
  find();
}
