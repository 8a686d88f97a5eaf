// @ts-check
/** One job beside what shows its shapes: what it was asked, how far it is, what its result is worth, what it left. Live while it runs, and the same after a reload, since everything comes from its events. */
import { announce } from "../announce.js";
import { readVerdict } from "../../client/index.js";
import { client, isAbort, MeshdeformError } from "../client.js";
import { DEMO } from "../demo.js";
import { fill, h, icon } from "../dom.js";
import { ago, goalWords, jobTitle, STATE_WORDS } from "../format.js";
import { emptyHistory, isTerminal, withEvent } from "../history.js";
import { stateBadge } from "../jobs/card.js";
import { currentLink } from "../key.js";
import { linkProblem, problemBox, temporary } from "../problem-box.js";
import { routeHash } from "../router.js";
import { verdictBadge, verdictWords } from "../verdict.js";
import { JobActions } from "./actions.js";
import { ProgressPanel } from "./progress.js";
import { filesPanel, parametersPanel, qualityPanel } from "./results.js";

const AGAIN_MS = 3000;

/**
 * @typedef {object} Hooks What shows the shapes of a job.
 * @property {(steps: number[], finished: boolean, lastStep: number) => void} offer Steps whose shape is kept, and whether there is a result.
 * @property {(report: any, artifacts: any[]) => unknown} finished What is there of a job that is over: its report, null where there is none, and its files.
 */

export class JobPanel {
  /** @param {any} job @param {import("../scope.js").Scope} scope @param {Hooks} hooks */
  constructor(job, scope, hooks) {
    this.job = job;
    this.scope = scope;
    this.hooks = hooks;
    this.history = emptyHistory();
    this.state = "";
    /** @type {any} */
    this.report = null;
    this.badge = h("span", { class: "badge-slot" });
    this.verdict = h("div", { class: "verdict", hidden: true });
    this.error = h("div", { class: "problem-slot" });
    this.progress = new ProgressPanel();
    this.actions = new JobActions(job, scope, () => this._refresh());
    /** What it left, and what it was asked for to the last number. */
    this.results = h("div", { class: "results" });
    this.settings = h("div", { class: "results" }, parametersPanel(job, null));
    this.head = this._head();
    this.top = h("div", { class: "job-top" }, job.unreadable ? problemBox(unreadable(job)) : null, this.verdict, this.error, this.progress.element);
    document.title = `${jobTitle(job)} · Meshdeform`;
    this._show();
  }

  _head() {
    const { job } = this;
    const { group } = job.metadata ?? {};
    const goal = goalWords(job);
    return h(
      "header",
      { class: "job-head" },
      currentLink()
        ? h("p", { class: "small muted" }, DEMO ? "A job of the built-in model, played as it ran." : "You see this job by a link. It shows no other job, and changes nothing.")
        : h("a", { class: "back", href: group ? routeHash({ name: "many", id: group }) : "#/jobs" }, icon("back"), group ? "All of them" : "Jobs"),
      h("h1", { class: "prompt-title" }, goal ? `“${goal}”` : jobTitle(job)),
      h("p", { class: "row meta" }, this.badge, h("span", null, [job.asset.filename, ago(job.created_at)].filter(Boolean).join(" · "))),
      this.actions.element,
    );
  }

  /** Follow the job until it is over. */
  async follow() {
    // A retry begins with a shape of its own.
    if (!isTerminal(this.job.state)) this.hooks.offer([], false, 0);
    /** @type {import("../history.js").JobEvent[]} */
    let together = [];
    const show = () => this.scope.over || this._take(together.splice(0));
    // However long it takes, the page connects again.
    const options = { signal: this.scope.signal, timeoutMs: Infinity, onConnection: (/** @type {boolean} */ on) => this.progress.connected(on) };
    try {
      for await (const event of client.watch(this.job.id, options)) {
        // Those that come together, after a reload all, are shown together.
        if (together.push(event) === 1) setTimeout(show);
      }
      this.progress.connected(true);
    } catch (error) {
      if (this.scope.over || isAbort(error)) return;
      const gone = error instanceof MeshdeformError && error.status === 404;
      fill(this.error, problemBox(gone ? { title: "This job was deleted", detail: "", advice: "" } : linkProblem(error)));
      if (gone) announce("This job was deleted");
    }
  }

  /** @param {import("../history.js").JobEvent[]} events */
  _take(events) {
    const before = this.history;
    for (const event of events) this.history = withEvent(this.history, event);
    if (this.history === before) return;
    this._show();
    if (this.history.checkpoints.length !== before.checkpoints.length && !isTerminal(this.history.state)) this._offer();
    if (isTerminal(this.history.state) && !isTerminal(before.state)) this._finish();
  }

  _show() {
    const { history, job } = this;
    const state = history.seq ? history.state : job.state;
    if (state !== this.state) {
      if (this.state) announce(`Job ${(STATE_WORDS[state] ?? state).toLowerCase()}`);
      this.state = state;
      fill(this.badge, stateBadge(state));
    }
    this.progress.show({ ...history, state }, job);
    this.actions.show(state);
    if (history.error) fill(this.error, problemBox(history.error));
  }

  /** Find out which steps' shapes are still kept. */
  async _offer() {
    try {
      const checkpoints = await client.checkpoints(this.job.id, this.scope.signal);
      this.hooks.offer(checkpoints.filter((found) => found.mesh).map((found) => found.step), this.history.state === "succeeded", this.history.progress.step);
    } catch (error) {
      if (!isAbort(error)) console.warn(error);
    }
  }

  async _finish() {
    await this._refresh();
    await this._offer();
    if (this.scope.over) return;
    const succeeded = this.history.state === "succeeded";
    try {
      const artifacts = await client.artifacts(this.job.id, this.scope.signal);
      if (succeeded) fill(this.error);
      this.report = artifacts.some(({ name }) => name === "report.json") ? await client.json(`v1/jobs/${this.job.id}/artifacts/report.json`, { signal: this.scope.signal }) : null;
      if (this.scope.over) return;
      this._judge();
      const measured = this.report?.quality || this.report?.levels;
      fill(this.results, measured ? qualityPanel(this.report, this.job.files) : null, filesPanel(this.job, artifacts, this.scope));
      if (this.report) fill(this.settings, parametersPanel(this.job, this.report));
      await this.hooks.finished(this.report, artifacts);
    } catch (error) {
      if (isAbort(error) || this.scope.over) return;
      if (succeeded) fill(this.error, problemBox(linkProblem(error)));
      if (temporary(error) && (await this.scope.sleep(AGAIN_MS))) await this._finish();
    }
  }

  /** Say what the result is worth: in a word or three, and why. */
  _judge() {
    const verdict = readVerdict(this.report);
    this.verdict.hidden = !verdict;
    if (!verdict) return;
    fill(this.badge, verdictBadge(verdict));
    fill(this.verdict, verdictWords(verdict));
  }

  async _refresh() {
    try {
      this.job = await client.get(this.job.id, this.scope.signal);
      this.actions.job = this.job;
      if (this.job.error) fill(this.error, problemBox(this.job.error));
    } catch (error) {
      if (!isAbort(error)) console.warn(error);
    }
  }
}

/** What is told about a job that only another version can read. @param {any} job */
function unreadable(job) {
  if (job.kind === "prior_teach") {
    return { title: "Lessons are no longer run", detail: job.unreadable, advice: "Its files can be downloaded. Add its meshes as a word to use them in prompts." };
  }
  return {
    title: "This server cannot read what the job was asked for",
    detail: job.unreadable,
    advice: "Servers and workers of the version that accepted it can. Here, it can be canceled and deleted.",
  };
}
