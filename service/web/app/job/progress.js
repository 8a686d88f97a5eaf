// @ts-check
/** How far a job is, how long it still takes, and what got in its way. */
import { h, say } from "../dom.js";
import { count, duration, percent, phaseWords, roughly, STATE_WORDS } from "../format.js";
import { isTerminal } from "../history.js";

const REASONS = /** @type {Record<string, string>} */ ({
  handed_back: "The worker was stopped",
  out_of_memory: "The worker ran out of memory",
  failure: "Something failed that may pass",
  handed_over: "Others had waited for long, and took over",
});

export class ProgressPanel {
  constructor() {
    this.bar = h("progress", { max: 1, "aria-label": "Progress" });
    this.words = h("p", { class: "progress-words" });
    this.numbers = h("p", { class: "progress-numbers" });
    this.notice = h("p", { class: "notice", role: "status", hidden: true });
    this.element = h("section", { class: "panel progress", "aria-label": "Progress" }, this.words, this.bar, this.numbers, this.notice);
    this.online = true;
    this.history = /** @type {import("../history.js").History | null} */ (null);
  }

  /** @param {import("../history.js").History} history @param {any} job */
  show(history, job) {
    const { progress, state } = history;
    this.history = history;
    this.element.hidden = state === "succeeded" || state === "failed";
    if (this.element.hidden) return;
    const over = isTerminal(state);
    if (state === "queued" || (state === "running" && !progress.total)) this.bar.removeAttribute("value");
    else this.bar.value = progress.fraction;
    this.bar.hidden = over && !progress.fraction;
    this.words.textContent = over || state === "canceling" ? STATE_WORDS[state] : phaseWords(progress.phase);
    const said = [
      progress.total ? `Step ${count(progress.step)} of ${count(progress.total)}` : "",
      progress.total && !over ? percent(progress.fraction) : "",
      progress.eta !== null && !over ? `about ${roughly(progress.eta)} left` : "",
      history.losses ? `attempt ${history.losses + 1}` : "",
      job.deadline_at && !over ? `ends by ${new Date(job.deadline_at).toLocaleTimeString("en")}` : "",
      over && history.startedAt && history.endedAt ? duration((Date.parse(history.endedAt) - Date.parse(history.startedAt)) / 1000) : "",
    ];
    this.numbers.textContent = said.filter(Boolean).join(" · ");
    this._notice();
  }

  /** @param {boolean} online Whether the job's events arrive. */
  connected(online) {
    this.online = online;
    this._notice();
  }

  _notice() {
    const text = this._trouble();
    if (this.notice.textContent !== text) say(this.notice, text);
  }

  /** What the user should know, in a sentence; empty: nothing. */
  _trouble() {
    const { history } = this;
    if (history && isTerminal(history.state)) return "";
    if (!this.online) return "Connection lost. Reconnecting; your job is safe.";
    if (!history?.interruption) return "";
    const { reason, step } = history.interruption;
    return `${REASONS[reason] ?? "The worker was lost"} at step ${count(step)}. The job continues by itself from its last checkpoint.`;
  }
}
