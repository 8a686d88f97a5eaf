// @ts-check
/** Two jobs side by side: their results in 3D, what was asked of each, and their figures. */
import { announce } from "../announce.js";
import { client, isAbort, MeshdeformError } from "../client.js";
import { fill, h, icon, panel } from "../dom.js";
import { ago, jobTitle } from "../format.js";
import { stateBadge } from "../jobs/card.js";
import { COLOURS, PairStage } from "../pair-stage.js";
import { problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";
import { askedRows, figureRows, obstacle } from "./model.js";

const LETTERS = ["A", "B"];
const GONE = "There is no such job here: it was deleted, or belongs to another key.";

export class CompareView {
  /** @param {HTMLElement} root @param {import("../scope.js").Scope} scope @param {[string, string]} ids */
  constructor(root, scope, ids) {
    this.scope = scope;
    this.ids = ids;
    /** @type {any[]} Documents of the jobs; null where there is none. */
    this.jobs = [];
    this.body = h("div", { class: "compare" }, h("p", { class: "loading", role: "status" }, "Loading both jobs…"));
    this.heads = h("div", { class: "compare-heads" });
    fill(root, this._header(), this.heads, this.body);
    document.title = "Comparison · Meshdeform";
    this._run();
  }

  _header() {
    const swap = routeHash({ name: "compare", ids: [this.ids[1], this.ids[0]] });
    return h(
      "header",
      { class: "job-head" },
      h("a", { class: "back", href: "#/jobs" }, icon("back"), "Jobs"),
      h("h1", null, "Comparison"),
      h("p", { class: "row meta" }, "Both cameras move together, at the same scale."),
      h(
        "div",
        { class: "row", role: "group", "aria-label": "Actions" },
        h("a", { class: "button", href: swap }, icon("turn"), "Swap"),
      ),
    );
  }

  async _run() {
    try {
      this.jobs = await Promise.all(this.ids.map((id) => this._job(id)));
      if (this.scope.over) return;
      fill(this.heads, this.jobs.map((job, i) => this._head(job, i)));
      if (this.jobs.every((job) => job && !obstacle(job))) await this._compare();
      else fill(this.body, h("p", { class: "lead" }, "These jobs cannot be compared: both must have a result. ", h("a", { href: "#/jobs" }, "Choose others")));
    } catch (error) {
      if (!this.scope.over && !isAbort(error)) fill(this.body, problemBox(error, h("a", { class: "button", href: "#/jobs" }, "All jobs")));
    }
  }

  /** @param {string} id @returns {Promise<any>} null where there is no such job, or none that this key may see */
  async _job(id) {
    try {
      return await client.get(id, this.scope.signal);
    } catch (error) {
      if (error instanceof MeshdeformError && (error.status === 404 || error.status === 403)) return null;
      throw error;
    }
  }

  /** @param {any} job @param {number} i */
  _head(job, i) {
    const wrong = job ? obstacle(job) : GONE;
    const title = job ? h("a", { href: routeHash({ name: "job", id: job.id }) }, jobTitle(job)) : "Not found";
    const facts = job ? [stateBadge(job.state), h("span", null, `${job.asset.filename} · variation ${job.params?.seed ?? 0} · ${ago(job.created_at)}`)] : h("code", null, this.ids[i]);
    return h(
      "section",
      { class: "panel compare-head", "aria-label": `Job ${LETTERS[i]}` },
      h("span", { class: "compare-letter" }, LETTERS[i]),
      h("div", null, h("h2", null, title), h("p", { class: "row meta small" }, facts), wrong ? h("p", { class: "small" }, wrong) : null),
    );
  }

  async _compare() {
    const [a, b] = this.jobs;
    const report = async (/** @type {any} */ job) => {
      try {
        return await client.json(`v1/jobs/${job.id}/artifacts/report.json`, { signal: this.scope.signal });
      } catch (error) {
        // Figures are missing then, and the shapes are still there.
        if (error instanceof MeshdeformError && error.status === 404) return null;
        throw error;
      }
    };
    const [shapes, reports] = await Promise.all([
      Promise.all(this.jobs.map((job) => client.bytes(`v1/jobs/${job.id}/artifacts/result.glb`, { signal: this.scope.signal }))),
      Promise.all(this.jobs.map(report)),
    ]);
    if (this.scope.over) return;
    const stage = new PairStage(this.scope, {
      label: "Both results",
      tags: [`A · ${jobTitle(a)}`, `B · ${jobTitle(b)}`],
      colours: COLOURS.slice(0, 2),
      always: true,
    });
    const note = h("p", { class: "small muted", role: "status" });
    fill(
      this.body,
      stage.element,
      note,
      h("div", { class: "compare-tables" }, table("Asked", askedRows(/** @type {any} */ (this.jobs), /** @type {any} */ (reports))), table("Result", figureRows(/** @type {any} */ (reports)))),
    );
    const comparable = await stage.show(shapes[0], shapes[1], a.asset.sha256 !== b.asset.sha256);
    if (this.scope.over) return;
    if (stage.flat) note.textContent = "Nothing can be drawn here; the figures are below.";
    else note.textContent = comparable ? "“Displacement” colours B by how far each point lies from where A has it." : "These are not two shapes of one asset, so how far apart they are cannot be shown as colours.";
    announce("Both results are shown");
  }
}

/** @param {string} title @param {import("./model.js").Row[]} rows */
function table(title, rows) {
  const id = `compare-${title.toLowerCase()}`;
  const cell = (/** @type {string} */ text) => h("td", null, text || "–");
  return panel(
    id,
    title,
    h(
      "table",
      { class: "compare-table", "aria-labelledby": id },
      h("thead", null, h("tr", null, h("td", null), LETTERS.map((letter) => h("th", { scope: "col" }, letter)))),
      h("tbody", null, rows.map(({ label, values, same }) => h("tr", { class: same ? null : "differs" }, h("th", { scope: "row" }, label), values.map(cell)))),
    ),
  );
}
