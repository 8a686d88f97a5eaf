// @ts-check
/** A job in a list: its picture, state, prompt and file; and the newest ones below a form. */
import { formatOf } from "../assets.js";
import { client } from "../client.js";
import { fill, h, icon } from "../dom.js";
import { ago, jobTitle, percent, roughly, STATE_WORDS } from "../format.js";
import { isTerminal, shareDone } from "../history.js";
import { isDeformation } from "../job/shapes.js";
import { currentKey } from "../key.js";
import { routeHash } from "../router.js";
import { verdictBadge } from "../verdict.js";
import { viewsOf } from "./cutout.js";

const GLYPHS = /** @type {Record<string, string>} */ ({
  queued: "clock", running: "play", canceling: "stop", succeeded: "check", failed: "warn", canceled: "cross", expired: "clock",
});

/** Of an asset that is loaded to be drawn here. */
const LARGEST = 1 << 22;

/** @param {string} state */
export function stateBadge(state) {
  return h("span", { class: `badge badge-${state}` }, icon(GLYPHS[state] ?? "info"), STATE_WORDS[state] ?? state);
}

/** The two views of a job's picture that stand for it: before and after; of a field and of a family, of the result. @param {any} job @returns {[number, [number, number][]]} */
function viewsIn({ kind = "" }) {
  if (kind.startsWith("family_")) return [160, [[0, 0], [1, 0]]];
  return [256, kind === "surface_fit" ? [[0, 1], [1, 1]] : [[0, 0], [0, 1]]];
}

export class JobCard {
  /** @param {any} job @param {import("../scope.js").Scope} scope @param {{level?: "h2" | "h3", onSelect?: () => void}} [options] */
  constructor(job, scope, options = {}) {
    this.scope = scope;
    this.id = job.id;
    this.picture = h("div", { class: "card-picture" });
    /** What stands for a job that has no result. */
    this.source = h("div", { class: "card-source" });
    this.bar = h("progress", { max: 1, "aria-label": "Progress", hidden: true });
    this.badge = h("span", null);
    this.meta = h("span", { class: "small muted" });
    this.title = h("a", { class: "card-link", href: routeHash({ name: "job", id: job.id }) }, jobTitle(job));
    this.box = h("input", { type: "checkbox", "aria-label": `Select ${jobTitle(job)}, ${job.asset?.filename ?? ""}`, on: { change: () => options.onSelect?.() } });
    this.element = h("li", { class: "card" }, options.onSelect ? h("span", { class: "card-select" }, this.box) : null, this.picture, h("div", { class: "card-text" }, h(options.level ?? "h2", null, this.title), h("div", { class: "row card-meta" }, this.badge, this.meta)));
    this.state = "";
    this.show(job);
  }

  /** @param {any} job */
  show(job) {
    const running = job.state === "running" || job.state === "canceling";
    const fraction = shareDone(job.progress);
    const { eta_s: eta } = job.progress;
    this.meta.textContent = running
      ? [percent(fraction), eta === null ? "" : `${roughly(eta)} left`].filter(Boolean).join(" · ")
      : [job.asset?.filename, job.unreadable ? "of another version" : "", ago(job.created_at)].filter(Boolean).join(" · ");
    this.box.disabled = !isTerminal(job.state);
    this.bar.hidden = !running;
    if (running) this.bar.value = fraction;
    if (job.state === this.state) return;
    this.state = job.state;
    fill(this.badge, stateBadge(job.state));
    if (job.state === "succeeded") {
      this._thumbnail(job);
      if (isDeformation(job) && job.artifacts?.some((/** @type {any} */ { name }) => name === "report.json")) this._judge();
    } else {
      fill(this.picture, this.source, this.bar);
      if (!this.source.childElementCount) this._source(job);
    }
  }

  /** Show the asset of a job that has no result yet, or never has one. @param {any} job */
  async _source(job) {
    fill(this.source, icon(GLYPHS[job.state] ?? "info"));
    if (!isDeformation(job) || job.asset.size > LARGEST) return;
    try {
      const [bytes, { snapshotAssets }] = await Promise.all([client.bytes(`v1/jobs/${this.id}/asset`, { signal: this.scope.signal }), import("../../viewer/snapshot.js")]);
      const [picture] = this.scope.over ? [] : await snapshotAssets([{ buffer: bytes, format: /** @type {any} */ (formatOf(job.asset.filename)) }], { width: 400, height: 200 });
      if (picture && !this.scope.over) fill(this.source, h("img", { src: this.scope.url(picture), alt: "" }));
    } catch {
      // It is gone, cannot be drawn, or the view has gone: the sign of the state stays.
    }
  }

  /** Show what the result is worth in place of the state. */
  async _judge() {
    try {
      const verdict = await client.verdict(this.id, this.scope.signal);
      if (verdict && !this.scope.over) fill(this.badge, verdictBadge(verdict));
    } catch {
      // The report is gone or cannot be read: the state stays.
    }
  }

  /** @param {any} job */
  async _thumbnail(job) {
    try {
      const sheet = await client.download(this.id, "preview.png", { signal: this.scope.signal });
      const views = await viewsOf(sheet, ...viewsIn(job));
      if (!this.scope.over) fill(this.picture, views.map((view) => h("img", { src: this.scope.url(view), alt: "" })));
    } catch {
      // There is no picture, or the view has gone.
      if (!this.scope.over) fill(this.picture, this.source);
      if (!this.scope.over) this._source(job);
    }
  }
}

/** The newest jobs, below the form for a new one. @param {import("../scope.js").Scope} scope */
export function recentJobs(scope) {
  const element = h("section", { class: "recent", "aria-labelledby": "recent-title", hidden: true });
  const load = () => client.jobPage({ limit: 6, signal: scope.signal }).then(
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
  scope.listen(document, "keychange", () => currentKey() && load());
  void load();
  return element;
}
