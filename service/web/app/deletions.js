// @ts-check
/**
 * Delete jobs, with time to undo it. Until that is over nothing is sent: the jobs are hidden, and still there.
 *
 * A page that goes away sends what is due with requests that outlive it.
 */
import { toast, toastWithUndo } from "./announce.js";
import { client, isAbort, MeshdeformError } from "./client.js";
import { counted } from "./format.js";
import { described } from "./problem-box.js";

/** Sent on `document` when a job becomes hidden, comes back or is deleted. */
export const CHANGED = "deletions";

/** @type {Set<string>} */
const hidden = new Set();
/** @type {Map<() => void, string[]>} closes the note about these jobs */
const waiting = new Map();

/** Whether a job is hidden, since it will be deleted. @param {string} id */
export function isDeleted(id) {
  return hidden.has(id);
}

/** @param {string[]} ids of jobs that have ended */
export function deleteJobs(ids) {
  for (const id of ids) hidden.add(id);
  const words = ids.length === 1 ? "Job deleted" : `${counted(ids.length, "job")} deleted`;
  const close = toastWithUndo(
    words,
    () => (waiting.delete(close), show(ids)),
    () => (waiting.delete(close), void send(ids)),
  );
  waiting.set(close, ids);
  changed();
}

/** @param {string[]} ids */
async function send(ids) {
  for (const [index, id] of ids.entries()) {
    try {
      await client.delete(id);
    } catch (error) {
      if (error instanceof MeshdeformError && error.status === 404) continue;
      show(ids.slice(index));
      if (!isAbort(error)) toast(`Not deleted. ${described(error).detail || described(error).title}`);
      return;
    }
  }
  changed();
}

/** @param {string[]} ids that are not deleted after all */
function show(ids) {
  for (const id of ids) hidden.delete(id);
  changed();
}

function changed() {
  document.dispatchEvent(new Event(CHANGED));
}

addEventListener("pagehide", () => {
  for (const [close, ids] of waiting) {
    close();
    // Nobody is left to hear that it failed.
    for (const id of ids) client.request(`v1/jobs/${id}`, { method: "DELETE", keepalive: true, once: true }).catch(() => {});
  }
  waiting.clear();
});
