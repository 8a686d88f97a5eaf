// @ts-check
/** One job: live while it runs, and the same after a reload, since everything comes from its events. */
import { announce } from "../announce.js";
import { readVerdict } from "../../client/index.js";
import { client, isAbort, isOffline, MeshdeformError } from "../client.js";
import { DEMO } from "../demo.js";
import { button, fill, h, icon } from "../dom.js";
import { ago, goalWords, jobTitle, STATE_WORDS } from "../format.js";
import { plainParams } from "../groups.js";
import { emptyHistory, isTerminal, withEvent } from "../history.js";
import { fitsOf } from "../exemplar.js";
import { currentLink } from "../key.js";
import { stateBadge } from "../jobs/card.js";
import { qualityWords } from "../params.js";
import { problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";
import { verdictBadge } from "../verdict.js";
import { JobActions } from "./actions.js";
import { askedPanel } from "./asked.js";
import { FamilyStage } from "./family-stage.js";
import { FieldStage } from "./field-stage.js";
import { PictureStage } from "./picture-stage.js";
import { ProgressPanel } from "./progress.js";
import { versionsPanel } from "./versions.js";
import { filesPanel, parametersPanel, qualityPanel } from "./results.js";
import { isDeformation } from "./shapes.js";
import { JobStage } from "./stage.js";
import { SynthesisPanel } from "./synthesis-panel.js";

export class JobView {
  /** @param {HTMLElement} root @param {import("../scope.js").Scope} scope @param {string} id */
  constructor(root, scope, id) {
    this.root = root;
    this.scope = scope;
    this.id = id;
    this.history = emptyHistory();
    /** @type {number[]} Steps whose shape is kept. */
    this.kept = [];
    /** @type {any} */
    this.report = null;
    this.state = "";
    fill(root, h("p", { class: "loading", role: "status" }, "Loading the job…"));
    this._open();
  }

  async _open() {
    for (let again = true; again && !this.scope.over; ) {
      again = false;
      try {
        this.job = await client.get(this.id, this.scope.signal);
      } catch (error) {
        if (isAbort(error) || this.scope.over) return;
        fill(this.root, h("h1", { class: "visually-hidden" }, "Job"), currentLink() ? problemBox(linkProblem(error)) : problemBox(error, h("a", { class: "button", href: "#/jobs" }, "All jobs")));
        again = temporary(error) && (await this.scope.sleep(3000));
      }
    }
    if (!this.job || this.scope.over) return;
    this._build();
    this._follow();
  }

  _build() {
    const { job, scope } = this;
    this.badge = h("span", { class: "badge-slot" });
    this.error = h("div", { class: "problem-slot" });
    this.progress = new ProgressPanel();
    this.stage = stageOf(job, scope);
    this.actions = new JobActions(job, scope, () => this._refresh(), () => this.stage?.chosenStep ?? null);
    this.results = h("div", { class: "results" });
    this.folds = h("div", { class: "results" }, parametersPanel(job, null));
    this.versions = h("div", { class: "results" });
    this._thread();
    const group = job.metadata?.group;
    const goal = goalWords(job);
    fill(
      this.root,
      h(
        "header",
        { class: "job-head" },
        currentLink()
          ? h("p", { class: "small muted" }, DEMO ? "A job of the built-in model, played as it ran." : "You see this job by a link. It shows no other job, and changes nothing.")
          : h("a", { class: "back", href: group ? routeHash({ name: "group", id: group }) : "#/jobs" }, icon("back"), group ? "All variations" : "Jobs"),
        h("h1", { class: "prompt-title" }, goal ? `“${goal}”` : jobTitle(job)),
        h("p", { class: "row meta" }, this.badge, meta(job)),
        this.actions.element,
      ),
      h(
        "div",
        { class: "job" },
        this.stage.element,
        h("div", { class: "job-side" }, job.unreadable ? problemBox(unreadable(job)) : null, this.error, this.progress.element, job.unreadable ? null : askedPanel(job), this.results, this.versions, this.folds),
      ),
    );
    document.title = `${jobTitle(job)} · Meshdeform`;
    // A retry and a new version begin with a shape of their own.
    if (!isTerminal(job.state)) this.stage.offer([], false, 0);
    this._show();
  }

  async _follow() {
    /** @type {import("../history.js").JobEvent[]} */
    let together = [];
    const show = () => this.scope.over || this._take(together.splice(0));
    // However long it takes, the page connects again.
    const options = { signal: this.scope.signal, timeoutMs: Infinity, onConnection: (/** @type {boolean} */ on) => this.progress?.connected(on) };
    try {
      for await (const event of client.watch(this.id, options)) {
        // Those that come together, after a reload all, are shown together.
        if (together.push(event) === 1) setTimeout(show);
      }
      this.progress?.connected(true);
    } catch (error) {
      if (this.scope.over || isAbort(error)) return;
      const gone = error instanceof MeshdeformError && error.status === 404;
      if (this.error) fill(this.error, problemBox(gone ? { title: "This job was deleted", detail: "", advice: "" } : linkProblem(error)));
      if (gone) announce("This job was deleted");
    }
  }

  /** @param {import("../history.js").JobEvent[]} events */
  _take(events) {
    const before = this.history;
    for (const event of events) this.history = withEvent(this.history, event);
    if (this.history === before) return;
    this._show();
    if (this.history.checkpoints.length !== before.checkpoints.length && !isTerminal(this.history.state)) this._keep();
    if (isTerminal(this.history.state) && !isTerminal(before.state)) this._finish();
  }

  _show() {
    const { history, job } = this;
    const state = history.seq ? history.state : job.state;
    if (state !== this.state) {
      if (this.state) announce(`Job ${(STATE_WORDS[state] ?? state).toLowerCase()}`);
      this.state = state;
      if (this.badge) fill(this.badge, stateBadge(state));
    }
    this.progress?.show({ ...history, state }, job);
    this.actions?.show(state, this.kept);
    if (this.error && history.error) fill(this.error, problemBox(history.error));
  }

  /** Show the versions of the asset, which a link does not give. */
  _thread() {
    if (this.versions && isDeformation(this.job) && !currentLink()) fill(this.versions, versionsPanel(this.job, this.scope));
  }

  /** Find out which steps' shapes are still kept. */
  async _keep() {
    try {
      const checkpoints = await client.checkpoints(this.id, this.scope.signal);
      this.kept = checkpoints.filter((found) => found.mesh).map((found) => found.step);
      this.stage?.offer(this.kept, this.history.state === "succeeded", this.history.progress.step);
      this.actions?.show(this.history.state, this.kept);
    } catch (error) {
      if (!isAbort(error)) console.warn(error);
    }
  }

  async _finish() {
    await this._refresh();
    await this._keep();
    if (this.scope.over) return;
    if (this.job.metadata?.thread) this._thread(); // it can be compared now
    const succeeded = this.history.state === "succeeded";
    try {
      const artifacts = await client.artifacts(this.id, this.scope.signal);
      const names = artifacts.map((found) => found.name);
      if (succeeded && this.error) fill(this.error);
      this.report = names.includes("report.json") ? await client.json(`v1/jobs/${this.id}/artifacts/report.json`, { signal: this.scope.signal }) : null;
      if (this.scope.over) return;
      const verdict = readVerdict(this.report);
      if (verdict && this.badge) fill(this.badge, verdictBadge(verdict));
      if (this.results) {
        fill(this.results, this.report?.quality || this.report?.levels ? qualityPanel(this.report, this._remedies(), this.job.files) : null, filesPanel(this.job, artifacts, this.scope));
      }
      this.actions?.offerDesigns(fitsOf(this.report).length > 0);
      if (this.report && this.stage instanceof FamilyStage) await this._family(this.stage, names);
      if (this.report && this.folds) fill(this.folds, parametersPanel(this.job, this.report));
      await this.stage?.ready;
      if (this.stage?.flat && names.includes("preview.png")) {
        this.stage.showPicture(await client.download(this.id, "preview.png", { signal: this.scope.signal }));
      }
    } catch (error) {
      if (isAbort(error) || this.scope.over) return;
      if (this.error && succeeded) fill(this.error, problemBox(linkProblem(error)));
      if (temporary(error) && (await this.scope.sleep(3000))) await this._finish();
    }
  }

  /** What does at once what the report advises. */
  _remedies() {
    const { stage, actions } = this;
    const weaker = stage instanceof JobStage ? button("Less strength", () => stage.weaken(), { title: "Show a shape nearer to your asset" }) : null;
    // A change in plain words has no variations, and those of a fit are among the actions.
    const other = this.report.way === "change" || fitsOf(this.report).length ? null : (actions?.variation() ?? null);
    return [other, weaker].filter((each) => each !== null);
  }

  /** @param {FamilyStage} stage @param {string[]} names Of the artifacts. */
  async _family(stage, names) {
    // Who came by a link makes no jobs.
    if (this.job.kind === "family_fit" && !currentLink() && this.results && names.includes("family.safetensors")) {
      const panel = new SynthesisPanel(this.job, this.report, names, this.scope, (members) => stage.choose(members));
      stage.onChoose = (name) => panel.take(name);
      this.results.prepend(panel.element);
    }
    await stage.finished(this.report);
  }

  async _refresh() {
    try {
      this.job = await client.get(this.id, this.scope.signal);
      if (this.actions) this.actions.job = this.job;
      if (this.stage) this.stage.job = this.job;
      if (this.job.error && this.error) fill(this.error, problemBox(this.job.error));
    } catch (error) {
      if (!isAbort(error)) console.warn(error);
    }
  }
}

/** What is wrong with a link, in place of what a key would be told; any other error stays. @param {unknown} error */
function linkProblem(error) {
  if (!currentLink() || !(error instanceof MeshdeformError) || error.status !== 401) return error;
  return { title: error.message, detail: "", advice: error.advice };
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

/** What shows the result of a job. @param {any} job @param {import("../scope.js").Scope} scope */
function stageOf(job, scope) {
  if (job.unreadable) return new PictureStage(job, scope);
  if (isDeformation(job)) return new JobStage(job, scope);
  if (job.kind.startsWith("family_")) return new FamilyStage(job, scope);
  return job.kind === "surface_fit" ? new FieldStage(job, scope) : new PictureStage(job, scope);
}

/** Return whether the same request may succeed a little later. @param {unknown} error */
function temporary(error) {
  return isOffline(error) || (error instanceof MeshdeformError && (error.status === 429 || error.status >= 500));
}

/** @param {any} job */
function meta(job) {
  const params = plainParams(job.params);
  if (!isDeformation(job)) return h("span", null, [job.asset.filename, ago(job.created_at)].filter(Boolean).join(" · "));
  const parts = [
    job.asset.filename,
    params.model && params.model !== "builtin" ? params.model : "",
    qualityWords(job),
    `variation ${params.seed ?? 0}`,
    ago(job.created_at),
  ];
  return h("span", null, parts.filter(Boolean).join(" · "));
}
