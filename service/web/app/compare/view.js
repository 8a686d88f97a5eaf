// @ts-check
/** Two jobs side by side: their results in 3D, what was asked of each, and their figures. */
import { announce } from "../announce.js";
import { client, isAbort, isOffline, MeshdeformError } from "../client.js";
import { button, fill, h, icon, panel } from "../dom.js";
import { ago, jobTitle } from "../format.js";
import { isTerminal } from "../history.js";
import { copyText } from "../job/files.js";
import { stateBadge } from "../jobs/card.js";
import { COLOURS, PairStage } from "../pair-stage.js";
import { problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";
import { askedRows, figureRows, obstacle } from "./model.js";

const POLL_MS = 3000;
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
        button("Copy link", () => copyText(location.href, "Link copied"), { icon: "link", quiet: true, class: "button-quiet" }),
      ),
    );
  }

  async _run() {
    if (this.ids[0] === this.ids[1]) {
      return this._say("These are the same job", "Choose two different jobs in the list.");
    }
    for (;;) {
      try {
        this.jobs = await Promise.all(this.ids.map((id) => this._job(id)));
        if (this.scope.over) return;
        this._showHeads();
        if (this.jobs.every((job) => job && !obstacle(job))) return await this._compare();
        if (!this.jobs.some((job) => job && !isTerminal(job.state))) return this._say("These jobs cannot be compared", "Both must have a result. Choose two others in the list.");
        this._say("Waiting for a result", "", true);
      } catch (error) {
        if (this.scope.over || isAbort(error)) return;
        fill(this.body, problemBox(error, h("a", { class: "button", href: "#/jobs" }, "All jobs")));
        if (!isOffline(error) && !(error instanceof MeshdeformError && error.status >= 500)) return;
      }
      if (!(await this.scope.sleep(POLL_MS))) return;
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

  /** @param {string} title @param {string} text @param {boolean} [waiting] */
  _say(title, text, waiting = false) {
    const known = this.body.querySelector("strong")?.textContent;
    if (known === title) return;
    fill(
      this.body,
      h("div", { class: "problem" }, icon(waiting ? "clock" : "info"), h("div", null, h("strong", null, title), text ? h("span", null, text) : null, waiting ? null : h("a", { href: "#/jobs" }, "All jobs"))),
    );
    announce(title);
  }

  _showHeads() {
    fill(this.heads, this.jobs.map((job, i) => this._head(job, i)));
  }

  /** @param {any} job @param {number} i */
  _head(job, i) {
    const letter = h("span", { class: "compare-letter" }, LETTERS[i]);
    if (!job) return h("section", { class: "panel compare-head", "aria-label": `Job ${LETTERS[i]}` }, letter, h("div", null, h("h2", null, "Not found"), h("p", { class: "small" }, GONE), h("p", { class: "small muted" }, h("code", null, this.ids[i]))));
    const wrong = obstacle(job);
    const link = h("a", { href: routeHash({ name: "job", id: job.id }) }, jobTitle(job));
    return h(
      "section",
      { class: "panel compare-head", "aria-label": `Job ${LETTERS[i]}` },
      letter,
      h("div", null, h("h2", null, link), h("p", { class: "row meta small" }, stateBadge(job.state), h("span", null, `${job.asset.filename} · variation ${job.params?.seed ?? 0} · ${ago(job.created_at)}`)), wrong ? h("p", { class: "small" }, wrong) : null),
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
