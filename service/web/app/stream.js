// @ts-check
/** A job's events, read live by `fetch`; after a broken connection they continue where they stopped. */
import { isAbort, OfflineError, ProblemError, request } from "./api.js";
import { isTerminal } from "./history.js";
import { backoff, EventParser } from "./sse.js";

// The server breaks its silence every 15 seconds.
const SILENCE_MS = 40000;

/**
 * @typedef {object} Listener
 * @property {(events: import("./history.js").JobEvent[]) => void} onEvents Those that came together.
 * @property {(status: "live" | "reconnecting" | "over") => void} onStatus
 */

/**
 * Follow a job until it is over, or the signal is aborted.
 *
 * @param {string} id
 * @param {Listener} listener
 * @param {AbortSignal} signal
 * @returns {Promise<void>} Rejects if trying again is of no use: the job is gone, or the key refused.
 */
export async function follow(id, listener, signal) {
  let last = "";
  let failures = 0;
  /** @type {number | null} */
  let least = null;
  while (!signal.aborted) {
    const parser = new EventParser();
    parser.lastId = last;
    try {
      const over = await read(id, parser, (events) => {
        failures = 0;
        last = String(events[events.length - 1].seq);
        listener.onEvents(events);
      }, () => listener.onStatus("live"), signal);
      if (over) return listener.onStatus("over");
    } catch (error) {
      if (signal.aborted || isAbort(error)) return;
      const status = error instanceof ProblemError ? error.status : 0;
      if (status && status < 500 && status !== 408 && status !== 429) throw error;
      least = error instanceof ProblemError && error.retryAfter ? 1000 * error.retryAfter : least;
    }
    least = parser.retry ?? least;
    if (signal.aborted) return;
    listener.onStatus("reconnecting");
    await pause(backoff(failures, failures ? least : 0), signal);
    failures += 1;
  }
}

/**
 * @param {string} id
 * @param {EventParser} parser
 * @param {(events: import("./history.js").JobEvent[]) => void} onEvents
 * @param {() => void} onOpen
 * @param {AbortSignal} signal
 * @returns {Promise<boolean>} False if more events may come.
 */
async function read(id, parser, onEvents, onOpen, signal) {
  const silence = new AbortController();
  let timer = 0;
  const heard = () => {
    clearTimeout(timer);
    timer = window.setTimeout(() => silence.abort(), SILENCE_MS);
  };
  const leave = () => silence.abort();
  signal.addEventListener("abort", leave);
  heard();
  try {
    /** @type {Record<string, string>} */
    const headers = { Accept: "text/event-stream" };
    if (parser.lastId) headers["Last-Event-ID"] = parser.lastId;
    const response = await request(`v1/jobs/${id}/events`, { headers, signal: silence.signal });
    if (response.status === 204 || response.body === null) return true;
    onOpen();
    const reader = response.body.getReader();
    const decoder = new TextDecoder();
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return false;
      heard();
      const events = parser.push(decoder.decode(value, { stream: true })).map((message) => JSON.parse(message.data));
      if (!events.length) continue;
      onEvents(events);
      if (isTerminal(events[events.length - 1].type)) return true;
    }
  } catch (error) {
    // Aborted by the timer, not by the page: the server is silent.
    if (isAbort(error) && !signal.aborted) throw new OfflineError();
    throw error;
  } finally {
    clearTimeout(timer);
    signal.removeEventListener("abort", leave);
    silence.abort();
  }
}

/**
 * Wait, but no longer than until the network is back.
 *
 * @param {number} milliseconds
 * @param {AbortSignal} signal
 * @returns {Promise<void>}
 */
function pause(milliseconds, signal) {
  return new Promise((resolve) => {
    const done = () => {
      clearTimeout(timer);
      window.removeEventListener("online", done);
      signal.removeEventListener("abort", done);
      resolve();
    };
    const timer = window.setTimeout(done, milliseconds);
    window.addEventListener("online", done);
    signal.addEventListener("abort", done);
  });
}
