// @ts-check
/** The client of the service that this page comes from, with what the page says and asks meanwhile. */
import { Client, MeshdeformError } from "../client/index.js";
import { DEMO, recordedFetch } from "./demo.js";
import { askUnlessLinked, credential } from "./key.js";

export { MeshdeformError };

// A server that asks for more is not waited for: the user is told.
const LONGEST_WAIT_S = 120;

export const client = new Client({
  // The page's own folder, so that it works below a prefix too. The tests in Node.js have no page.
  ...(globalThis.document ? { baseUrl: new URL(".", document.baseURI) } : {}),
  ...(DEMO ? { fetch: recordedFetch } : {}),
  apiKey: credential,
  onUnauthorized: askUnlessLinked,
  // The page's policy keeps it from other hosts, such as a bucket.
  directUploads: false,
  timeoutMs: 600_000,
  onRetry(error, { keyed }) {
    // What must be done exactly once is sent until it arrives; of anything else the view says at once that it failed.
    if (error.code !== "rate_limited" || error.retryAfterS === null) return keyed;
    if (error.retryAfterS > LONGEST_WAIT_S) return false;
    document.dispatchEvent(new CustomEvent("ratelimited", { detail: error.retryAfterS }));
    return true;
  },
});

/** Return whether a view left what it had asked for. @param {unknown} error */
export function isAbort(error) {
  return error instanceof DOMException && error.name === "AbortError";
}

/** What the server refuses, field by field. @param {unknown} error @returns {any[]} */
export function errorsOf(error) {
  const errors = error instanceof MeshdeformError ? error.problem?.errors : null;
  return Array.isArray(errors) ? errors : [];
}

/** Return whether no answer came. @param {unknown} error @returns {boolean} */
export function isOffline(error) {
  return error instanceof MeshdeformError && error.unanswered;
}
