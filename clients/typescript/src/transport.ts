/** Requests that are sent again where that can help and does nothing twice. */
import { errorOf, MeshdeformError } from "./errors.js";

export interface Options {
  /** Address of the service, optionally with a path. Default: this page's origin, or `http://127.0.0.1:8765`. */
  baseUrl?: string | URL;
  /** Sent to the service as a bearer token, and to nobody else. */
  apiKey?: string;
  /** Default: the global one. */
  fetch?: typeof fetch;
  /** How often to repeat a request that got no answer, or 408, 429, 502, 503 or 504. Default: 4. */
  maxRetries?: number;
  /** For how long after the first failure to repeat it, in milliseconds. Default: 60,000. */
  timeoutMs?: number;
}

export interface Call {
  method?: string;
  headers?: Record<string, string>;
  body?: BodyInit;
  json?: unknown;
  signal?: AbortSignal | undefined;
  /** The URL carries its own permission, perhaps of another host: no key is sent along. */
  signed?: boolean;
  /** Whether to return the failed response's error as soon as it comes. */
  once?: boolean;
}

const AGAIN: ReadonlySet<number> = new Set([408, 429, 502, 503, 504]);
const FIRST_PAUSE_MS = 250;
const LONGEST_PAUSE_MS = 8_000;

/** Return whether the same request may succeed later. */
export function worthRetrying(error: unknown): error is MeshdeformError {
  if (!(error instanceof MeshdeformError)) return false;
  return error.status === 0 ? error.code === "unavailable" : AGAIN.has(error.status) || error.code === "idempotency_in_flight";
}

/** Counts failures in a row, and waits after each. */
export class Patience {
  #failures = 0;
  #since = 0;

  constructor(
    private readonly retries: number,
    private readonly timeoutMs: number,
  ) {}

  /** Forget the failures after progress. */
  renew(): void {
    this.#failures = 0;
  }

  /** Wait before the next try, or throw the error if retries or time are used up. */
  async wait(error: MeshdeformError, signal?: AbortSignal): Promise<void> {
    const now = Date.now();
    if (this.#failures === 0) this.#since = now;
    this.#failures += 1;
    if (this.#failures > this.retries) throw error;
    let pause = Math.min(FIRST_PAUSE_MS * 2 ** (this.#failures - 1), LONGEST_PAUSE_MS) * (0.5 + 0.5 * Math.random());
    // At least as long as the service asks for, and not all at the same moment.
    if (error.retryAfterS !== null) pause = 1000 * error.retryAfterS + 0.25 * pause;
    if (now + pause > this.#since + this.timeoutMs) throw error;
    await sleep(pause, signal);
  }
}

/** Wait for some milliseconds, or throw when the signal aborts. */
export function sleep(milliseconds: number, signal?: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    signal?.throwIfAborted();
    const stop = () => {
      clearTimeout(timer);
      reject(signal?.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", stop);
      resolve();
    }, milliseconds);
    signal?.addEventListener("abort", stop, { once: true });
  });
}

export class Transport {
  readonly baseUrl: string;
  readonly maxRetries: number;
  readonly timeoutMs: number;
  readonly #apiKey: string;
  readonly #fetch: typeof fetch;

  constructor(options: Options) {
    const here = typeof location === "undefined" ? "http://127.0.0.1:8765" : location.origin;
    this.baseUrl = String(options.baseUrl ?? here).replace(/\/+$/, "");
    if (!/^https?:\/\/[^/]/.test(this.baseUrl)) throw new TypeError(`${this.baseUrl} is not an address such as https://example.org.`);
    this.maxRetries = options.maxRetries ?? 4;
    this.timeoutMs = options.timeoutMs ?? 60_000;
    this.#apiKey = options.apiKey ?? "";
    // Browsers refuse to call `fetch` as a method of another object.
    this.#fetch = options.fetch ?? ((input, init) => globalThis.fetch(input, init));
  }

  patience(): Patience {
    return new Patience(this.maxRetries, this.timeoutMs);
  }

  /** Send a request, again if need be, and return the successful response. The request must be safe to repeat. */
  async request(path: string, call: Call = {}): Promise<Response> {
    const patience = this.patience();
    for (let lost = false; ; ) {
      let error: MeshdeformError;
      try {
        const response = await this.#send(path, call);
        if (response.ok) return response;
        // The first request succeeded, and its answer was lost.
        if (lost && call.method === "DELETE" && response.status === 404) return response;
        error = await errorOf(response);
      } catch (failure) {
        if (!worthRetrying(failure)) throw failure;
        error = failure;
        lost = true;
      }
      if (call.once || !worthRetrying(error)) throw error;
      await patience.wait(error, call.signal);
    }
  }

  /** Send a request and return the document of the answer. */
  async json<T>(path: string, call: Call = {}): Promise<T> {
    const response = await this.request(path, call);
    return (await response.json()) as T;
  }

  async #send(path: string, call: Call): Promise<Response> {
    const url = /^https?:/.test(path) ? path : `${this.baseUrl}/${path.replace(/^\//, "")}`;
    const headers = new Headers(call.headers);
    if (this.#apiKey && !call.signed) headers.set("Authorization", `Bearer ${this.#apiKey}`);
    const init: RequestInit = { method: call.method ?? "GET", headers };
    if (call.json !== undefined) {
      headers.set("Content-Type", "application/json");
      init.body = JSON.stringify(call.json);
    } else if (call.body !== undefined) init.body = call.body;
    if (call.signal) init.signal = call.signal;
    try {
      return await this.#fetch(url, init);
    } catch (failure) {
      call.signal?.throwIfAborted();
      const detail = `${this.baseUrl} does not answer.`;
      const advice = "Check the address of the service, and that it is running.";
      throw new MeshdeformError(0, { code: "unavailable", detail, advice }, null, { cause: failure });
    }
  }
}

/** Return a key for a request that may be repeated, and must be carried out once. */
export function newKey(): string {
  return [...crypto.getRandomValues(new Uint32Array(4))].map((word) => word.toString(16).padStart(8, "0")).join("");
}
