// @ts-check
/** What can be done with a job. */
import { Asset } from "../assets.js";
import { client } from "../client.js";
import { resultOrigin } from "../create/origins.js";
import { ask } from "../dialogs.js";
import { button, fill, h } from "../dom.js";
import { forgetDraftOf } from "../drafts.js";
import { count, roughly } from "../format.js";
import { isTerminal } from "../history.js";
import { currentLink } from "../key.js";
import { artifactName } from "../names.js";
import { checkpointEvery, otherVariation, refinement } from "../params.js";
import { orToast } from "../problem-box.js";
import { isAboutPrompt, showRefusal } from "../refusal.js";
import { routeHash } from "../router.js";
import { copyLink, download } from "./files.js";
import { isDeformation } from "./shapes.js";
import { threadOf } from "./versions.js";

// A refinement that takes longer is asked about first.
const LONG_S = 600;

export class JobActions {
  /**
   * @param {any} job
   * @param {import("../scope.js").Scope} scope
   * @param {() => void} onChange
   * @param {() => number | null} chosenStep The step that is looked at.
   */
  constructor(job, scope, onChange, chosenStep) {
    this.job = job;
    this.scope = scope;
    this.onChange = onChange;
    this.chosenStep = chosenStep;
    this.element = h("div", { class: "row", role: "group", "aria-label": "Actions" });
    this.key = "";
    this.state = "";
    /** @type {number[]} */
    this.checkpoints = [];
    this.busy = false;
    /** Whether another seed takes another shape to fit the asset to. */
    this.designs = false;
    /** What was typed for a new version, for whoever closes the dialog by mistake. */
    this.typed = "";
  }

  /** @param {string} state @param {number[]} checkpoints */
  show(state, checkpoints) {
    const key = `${state} ${checkpoints.length > 0} ${this.designs}`;
    this.checkpoints = checkpoints;
    this.state = state;
    if (key === this.key) return;
    this.key = key;
    // What is pressed must not vanish from under the focus without another place for it.
    const focused = this.element.contains(document.activeElement);
    const over = isTerminal(state);
    const deforms = isDeformation(this.job);
    if (currentLink()) {
      fill(this.element, state === "succeeded" && deforms ? button("Download result", () => this._download(), { icon: "download", class: "button-primary" }) : null);
      return;
    }
    const better = state === "succeeded" && deforms ? refinement(this.job) : null;
    fill(
      this.element,
      state === "succeeded" && deforms ? button("Download result", () => this._download(), { icon: "download", class: "button-primary" }) : null,
      this.designs ? this.variation("Another design") : null,
      better ? button("Refine", () => this._refine(better), { icon: "spark", title: `The same variation again, at quality ${better.title}` }) : null,
      !over ? button(state === "canceling" ? "Canceling…" : "Cancel", () => this._cancel(), { icon: "stop" }) : null,
      over && state !== "succeeded" && !this.job.unreadable ? button("Retry", () => this._retry(), { icon: "retry", class: "button-primary" }) : null,
      checkpoints.length && deforms ? button("New version", () => this._branch(), { icon: "branch", title: "Start another job from one of these steps" }) : null,
      state === "succeeded" && deforms ? button("Continue from it", () => this._continue(), { icon: "edit", title: "Start another job on this result" }) : null,
      over && formOf(this.job) ? button("Edit and run again", () => this._edit(), { icon: "edit" }) : null,
      button("Share", () => copyLink(`v1/jobs/${this.job.id}`, this.scope, "shows this job with its files, also the asset as you sent it, "), {
        icon: "share", quiet: true, class: "button-quiet", title: "Copy a link that shows this job without a key",
      }),
      over ? button("Delete", () => this._delete(), { icon: "trash", quiet: true, class: "button-quiet" }) : null,
    );
    if (state === "canceling") this.element.querySelector("button")?.setAttribute("aria-disabled", "true");
    if (focused) this.element.querySelector("button")?.focus();
  }

  _download() {
    const size = this.job.asset?.size ?? 0;
    return download(`v1/jobs/${this.job.id}/artifacts/result.glb`, artifactName(this.job, "result.glb"), size, true, this.scope);
  }

  /** Open the form with this job's settings, not with those that were changed there before. */
  _edit() {
    forgetDraftOf(this.job.id);
    const name = formOf(this.job);
    if (name) location.hash = routeHash({ name, from: this.job.id });
  }

  _continue() {
    forgetDraftOf(resultOrigin(this.job.id));
    location.hash = routeHash({ name: "create", from: this.job.id, result: true });
  }

  _cancel() {
    return orToast("Not canceled", async () => {
      await client.cancel(this.job);
      this.onChange();
    });
  }

  _retry() {
    return orToast("Not retried", async () => {
      const job = await client.retry(this.job);
      location.hash = routeHash({ name: "job", id: job.id });
    });
  }

  /** The same variation at the next quality. @param {{title: string, document: any}} better */
  async _refine({ title, document }) {
    if (this.busy) return;
    this.busy = true;
    await orToast("Not refined", async () => {
      const asset = new Asset(await client.file(this.job, "asset", this.scope.signal), this.job.asset.filename);
      const checked = await client.validate(...(await asset.submission(document)));
      document.params.checkpoint_every_steps = checkpointEvery(checked.params.steps);
      const start = async () => {
        const job = await client.submit(...(await asset.submission(document)));
        location.hash = routeHash({ name: "job", id: job.id });
      };
      const seconds = checked.estimate.run_s;
      if (seconds !== null && seconds < LONG_S) return await start();
      const time = seconds === null ? "How long is unknown yet" : `About ${roughly(seconds)}`;
      const body = [h("p", null, `${count(checked.params.steps)} steps. ${time}.`)];
      ask({ title: `Refine at quality ${title}?`, body, action: "Refine", act: start }, this.scope);
    });
    this.busy = false;
  }

  /** Offer another shape of the same word, where that makes a difference. @param {boolean} on */
  offerDesigns(on) {
    this.designs = on;
    this.show(this.state, this.checkpoints);
  }

  /** A button for the same request with another variation; null where it makes no difference, or for a link. */
  variation(label = "Another variation") {
    const document = currentLink() ? null : otherVariation(this.job);
    return document ? button(label, () => this._vary(document), { icon: "spark", title: "The same request once more, with another seed" }) : null;
  }

  /** @param {any} document */
  async _vary(document) {
    if (this.busy) return;
    this.busy = true;
    await orToast("Not started", async () => {
      const asset = new Asset(await client.file(this.job, "asset", this.scope.signal), this.job.asset.filename);
      const job = await client.submit(...(await asset.submission(document)));
      location.hash = routeHash({ name: "job", id: job.id });
    });
    this.busy = false;
  }

  _delete() {
    ask(
      {
        title: "Delete this job?",
        body: [h("p", null, "Its results, steps and asset are deleted too.")],
        action: "Delete",
        danger: true,
        act: async () => {
          await client.delete(this.job.id);
          location.hash = routeHash({ name: "jobs", state: null });
        },
      },
      this.scope,
    );
  }

  _branch() {
    const prompt = h("textarea", { id: "branch-prompt", rows: 2, maxlength: 1000, required: true, ".value": this.typed || this.job.prompt });
    prompt.addEventListener("input", () => (this.typed = prompt.value));
    const kept = this.checkpoints;
    const step = h("select", { id: "branch-step" }, [...kept].reverse().map((found) => h("option", { value: found }, `Step ${count(found)}`)));
    const looked = this.chosenStep();
    if (looked !== null && kept.includes(looked)) step.value = String(looked);
    ask(
      {
        title: "New version",
        body: [
          h("p", { class: "muted" }, "A new job on the same asset that starts from this shape."),
          h("label", { class: "field-label", for: "branch-step" }, "Start from"),
          step,
          h("label", { class: "field-label", for: "branch-prompt" }, "Prompt"),
          prompt,
        ],
        action: "Start",
        explain: (error, place) => {
          if (!isAboutPrompt(error)) return false;
          showRefusal(place, error, (text) => {
            prompt.value = this.typed = text;
            place.replaceChildren();
            prompt.focus();
          });
          return true;
        },
        act: async () => {
          const steps = this.job.params.steps ?? this.job.progress.total_steps;
          const params = { ...this.job.params, ...(steps ? { checkpoint_every_steps: checkpointEvery(steps) } : {}) };
          const request = { prompt: prompt.value.trim(), params, output: this.job.output, metadata: { ...this.job.metadata, thread: threadOf(this.job) } };
          const job = await client.branch(this.job, Number(step.value), request);
          location.hash = routeHash({ name: "job", id: job.id });
        },
      },
      this.scope,
    );
  }
}

/** The form that makes such jobs, if it can begin with one. @param {any} job @returns {import("../create/form.js").Kind | null} */
function formOf(job) {
  if (job.unreadable) return null;
  if (isDeformation(job)) return "create";
  return /** @type {Record<string, "surface" | "family">} */ ({ surface_fit: "surface", family_fit: "family" })[job.kind] ?? null;
}
