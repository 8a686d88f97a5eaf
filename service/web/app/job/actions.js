// @ts-check
/** What can be done with a job, besides what the workbench does with its shape. */
import { client } from "../client.js";
import { resultOrigin } from "../create/origins.js";
import { ask } from "../dialogs.js";
import { button, fill, h } from "../dom.js";
import { forgetDraftOf } from "../drafts.js";
import { isTerminal } from "../history.js";
import { currentLink } from "../key.js";
import { orToast } from "../problem-box.js";
import { routeHash } from "../router.js";
import { copyLink } from "./files.js";
import { isDeformation } from "./shapes.js";

/** The forms that can begin with a job of another kind. @type {Record<string, "surface" | "family">} */
const FORMS = { surface_fit: "surface", family_fit: "family" };

export class JobActions {
  /** @param {any} job @param {import("../scope.js").Scope} scope @param {() => void} onChange */
  constructor(job, scope, onChange) {
    this.job = job;
    this.scope = scope;
    this.onChange = onChange;
    this.element = h("div", { class: "row", role: "group", "aria-label": "Actions" });
    this.state = "";
  }

  /** @param {string} state */
  show(state) {
    if (state === this.state) return;
    this.state = state;
    // Who came by a link changes nothing.
    if (currentLink()) return;
    // What is pressed must not vanish from under the focus without another place for it.
    const focused = this.element.contains(document.activeElement);
    const over = isTerminal(state);
    const deforms = isDeformation(this.job);
    const form = this.job.unreadable ? undefined : FORMS[this.job.kind];
    fill(
      this.element,
      !over ? button(state === "canceling" ? "Canceling…" : "Cancel", () => this._cancel(), { icon: "stop" }) : null,
      over && state !== "succeeded" && !this.job.unreadable ? button("Retry", () => this._retry(), { icon: "retry", class: "button-primary" }) : null,
      over && form ? button("Edit and run again", () => this._go({ name: form, from: this.job.id }), { icon: "edit" }) : null,
      state === "succeeded" && deforms ? button("Continue from it", () => this._go({ name: "create", from: this.job.id, result: true }), { icon: "edit", title: "Take this result as the asset" }) : null,
      button("Share", () => copyLink(`v1/jobs/${this.job.id}`, this.scope, "shows this job with its files, also the asset as you sent it, "), {
        icon: "share", quiet: true, class: "button-quiet", title: "Copy a link that shows this job without a key",
      }),
      over ? button("Delete", () => this._delete(), { icon: "trash", quiet: true, class: "button-quiet" }) : null,
    );
    if (state === "canceling") this.element.querySelector("button")?.setAttribute("aria-disabled", "true");
    if (focused) this.element.querySelector("button")?.focus();
  }

  /** Open a form with this job's settings or result, not with those that were changed there before. @param {Extract<import("../router.js").Route, {from: string | null}>} route */
  _go(route) {
    forgetDraftOf(route.name === "create" ? resultOrigin(this.job.id) : this.job.id);
    location.hash = routeHash(route);
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
}
