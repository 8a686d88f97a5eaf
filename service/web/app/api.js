// @ts-check
/**
 * Requests to the API that serves this page. Every path is resolved against the page's own folder, so that the page
 * also works below a prefix.
 *
 * @typedef {object} Asked
 * @property {string} [method]
 * @property {any} [json] Sent as JSON.
 * @property {BodyInit} [body] Sent as it is.
 * @property {Record<string, string>} [headers]
 * @property {AbortSignal} [signal]
 */
import { askForKey, currentKey } from "./key.js";

/** A response that says what is wrong (RFC 9457). */
export class ProblemError extends Error {
  /**
   * @param {number} status
   * @param {Record<string, any>} document
   * @param {number | null} retryAfter Seconds.
   */
  constructor(status, document, retryAfter = null) {
    super(String(document.detail ?? document.title ?? `The server answered ${status}.`));
    this.name = "ProblemError";
    this.status = status;
    this.code = String(document.code ?? `http_${status}`);
    this.title = String(document.title ?? `The server answered ${status}`);
    this.advice = String(document.advice ?? "");
    this.requestId = document.request_id ? String(document.request_id) : "";
    this.document = document;
    this.retryAfter = retryAfter;
  }
}

// A server that asks for more is not waited for: the user is told.
const LONGEST_WAIT_S = 120;

/** No answer came. */
export class OfflineError extends Error {
  constructor() {
    super("The server does not answer.");
    this.name = "OfflineError";
    this.advice = "Check your connection and that the server is running. Nothing is lost.";
  }
}

/** @param {unknown} error */
export function isAbort(error) {
  return error instanceof DOMException && error.name === "AbortError";
}

/**
 * The address of a path of this server, whether it begins with a slash or not.
 *
 * @param {string} path
 */
export function address(path) {
  return new URL(path.replace(/^\//, ""), document.baseURI).href;
}

/**
 * Send a request. If the server requires an API key, ask the user for it; if it limits the rate, wait; then send again.
 *
 * @param {string} path
 * @param {Asked} [asked]
 * @returns {Promise<Response>} A successful response; any other is thrown as a `ProblemError`.
 */
export async function request(path, asked = {}) {
  for (;;) {
    const key = currentKey();
    const headers = new Headers(asked.headers);
    if (key) headers.set("Authorization", `Bearer ${key}`);
    if (asked.json !== undefined) headers.set("Content-Type", "application/json");
    const response = await answered(address(path), {
      method: asked.method ?? "GET",
      headers,
      body: asked.json !== undefined ? JSON.stringify(asked.json) : asked.body,
      signal: asked.signal,
      credentials: "same-origin",
    });
    if (response.status === 401 && (await askForKey(key, asked.signal))) continue;
    if (response.ok || response.status === 304) return response;
    const found = await problem(response);
    if (!rateLimited(found)) throw found;
    await wait(found.retryAfter ?? 1, asked.signal);
  }
}

/**
 * Return whether the request was refused for coming too soon; such a request has done nothing, and may be sent again.
 *
 * @param {ProblemError} error
 */
function rateLimited({ status, code, retryAfter }) {
  return status === 429 && code === "rate_limited" && retryAfter !== null && retryAfter <= LONGEST_WAIT_S;
}

/**
 * Wait before the next try, and announce it.
 *
 * @param {number} seconds
 * @param {AbortSignal} [signal]
 * @returns {Promise<void>}
 */
function wait(seconds, signal) {
  document.dispatchEvent(new CustomEvent("ratelimited", { detail: seconds }));
  // A little later each, so that those that wait together do not come together.
  const milliseconds = 1000 * seconds * (1 + 0.2 * Math.random());
  return new Promise((resolve, reject) => {
    const leave = () => (clearTimeout(timer), reject(new DOMException("Left", "AbortError")));
    const timer = setTimeout(() => (signal?.removeEventListener("abort", leave), resolve()), milliseconds);
    if (signal?.aborted) leave();
    signal?.addEventListener("abort", leave, { once: true });
  });
}

/**
 * @param {string} url
 * @param {RequestInit} options
 */
async function answered(url, options) {
  try {
    return await fetch(url, options);
  } catch (error) {
    if (isAbort(error) || options.signal?.aborted) throw new DOMException("Left", "AbortError");
    throw new OfflineError();
  }
}

/** @param {Response} response */
export async function problem(response) {
  const retry = Number(response.headers.get("Retry-After"));
  let found = {};
  try {
    found = await response.json();
  } catch {
    // A proxy's page, perhaps: the status says enough.
  }
  return new ProblemError(response.status, found ?? {}, Number.isFinite(retry) && retry > 0 ? retry : null);
}

/**
 * @param {string} path
 * @param {Asked} [asked]
 * @returns {Promise<any>}
 */
export async function requestJson(path, asked = {}) {
  const response = await request(path, { ...asked, headers: { Accept: "application/json", ...asked.headers } });
  return response.status === 204 ? null : response.json();
}

/**
 * @param {string} path
 * @param {AbortSignal} [signal]
 * @returns {Promise<ArrayBuffer>}
 */
export async function requestBytes(path, signal) {
  const response = await request(path, { signal });
  try {
    return await response.arrayBuffer();
  } catch (error) {
    if (signal?.aborted) throw new DOMException("Left", "AbortError");
    throw new OfflineError();
  }
}

/** Return a new idempotency key. */
export function idempotencyKey() {
  const random = crypto.getRandomValues(new Uint8Array(16));
  return "web-" + [...random].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

/**
 * Send what must be done exactly once: if no answer comes, send it again under the same key.
 *
 * @param {string} path
 * @param {Asked} asked
 */
export async function requestOnce(path, asked) {
  const headers = { ...asked.headers, "Idempotency-Key": idempotencyKey() };
  for (let attempt = 0; ; attempt += 1) {
    try {
      return await requestJson(path, { ...asked, method: "POST", headers });
    } catch (error) {
      const again = error instanceof OfflineError || (error instanceof ProblemError && error.status === 503);
      if (!again || attempt >= 3) throw error;
      await new Promise((resolve) => setTimeout(resolve, 500 * 2 ** attempt));
    }
  }
}
