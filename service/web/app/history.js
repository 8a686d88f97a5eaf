// @ts-check
/**
 * A job's history, built from its events: the same whether they come live or all at once after a reload.
 *
 * @typedef {{seq: number, job_id: string, type: string, at: string, attempt: number, data: Record<string, any>}} JobEvent
 * @typedef {{step: number, total: number, fraction: number, phase: string, eta: number | null}} Progress
 * @typedef {{reason: string, step: number}} Interruption Why the last attempt ended, and at which step.
 * @typedef {object} History
 * @property {number} seq Number of the newest event; 0 before the first.
 * @property {string} state
 * @property {number} losses Attempts that ended without the worker handing the job back in order.
 * @property {Interruption | null} interruption The last one, until the job is as far again.
 * @property {Progress} progress
 * @property {number[]} checkpoints Steps, ascending.
 * @property {Record<string, any> | null} error
 * @property {string | null} startedAt
 * @property {string | null} endedAt
 */
import { isTerminal } from "../client/index.js";

export { isTerminal };

/** @returns {History} */
export function emptyHistory() {
  return {
    seq: 0,
    state: "queued",
    losses: 0,
    interruption: null,
    progress: { step: 0, total: 0, fraction: 0, phase: "queued", eta: null },
    checkpoints: [],
    error: null,
    startedAt: null,
    endedAt: null,
  };
}

/**
 * Return the history after one more event. An event that is known already changes nothing.
 * @param {History} history
 * @param {JobEvent} event
 * @returns {History}
 */
export function withEvent(history, event) {
  if (event.seq <= history.seq) return history;
  const next = { ...history, seq: event.seq };
  const data = event.data ?? {};
  switch (event.type) {
    case "queued":
      next.state = "queued";
      break;
    case "started":
      next.state = "running";
      next.startedAt = history.startedAt ?? event.at;
      break;
    case "recovered":
      next.state = "queued";
      next.losses += data.reason === "handed_back" ? 0 : 1;
      next.interruption = { reason: String(data.reason ?? ""), step: history.progress.step };
      next.progress = { ...history.progress, phase: "queued", eta: null };
      break;
    case "progress":
      if (next.state === "queued") next.state = "running";
      next.progress = readProgress(data);
      if (history.interruption && next.progress.step > history.interruption.step) next.interruption = null;
      break;
    case "checkpoint":
      next.checkpoints = [...new Set([...history.checkpoints, Number(data.step)])].sort((a, b) => a - b);
      break;
    case "canceling":
      next.state = "canceling";
      break;
    default:
      if (!isTerminal(event.type)) return next;
      next.state = event.type;
      next.endedAt = event.at;
      next.error = data.error ?? (data.code ? data : null);
      next.progress = { ...history.progress, eta: null };
  }
  return next;
}

/**
 * The share of the steps that is done. The API's `fraction` never goes back; the steps of a recovered job do.
 * @param {Record<string, any>} progress As in events and jobs.
 */
export function shareDone(progress) {
  const total = Number(progress.total_steps) || 0;
  return total ? (Number(progress.step) || 0) / total : Number(progress.fraction) || 0;
}

/** @param {Record<string, any>} data @returns {Progress} */
function readProgress(data) {
  return {
    step: Number(data.step) || 0,
    total: Number(data.total_steps) || 0,
    fraction: shareDone(data),
    phase: String(data.phase ?? ""),
    eta: typeof data.eta_s === "number" ? data.eta_s : null,
  };
}
