/** Requests that are sent again where that can help and does nothing twice. */
import { errorOf, MeshdeformError } from "./errors.js";
const AGAIN = new Set([408, 429, 502, 503, 504]);
const FIRST_PAUSE_MS = 250;
const LONGEST_PAUSE_MS = 8_000;
/** Return whether the same request may succeed later. */
export function worthRetrying(error) {
    if (!(error instanceof MeshdeformError))
        return false;
    return error.status === 0 ? error.unanswered : AGAIN.has(error.status) || error.code === "idempotency_in_flight";
}
/** Counts failures in a row, and waits after each. */
export class Patience {
    retries;
    timeoutMs;
    #failures = 0;
    #since = null;
    constructor(retries, timeoutMs) {
        this.retries = retries;
        this.timeoutMs = timeoutMs;
    }
    /** Forget the failures after progress. */
    renew() {
        this.#failures = 0;
        this.#since = null;
    }
    /**
     * Wait before the next try, or throw the error if retries or time are used up, or `goesOn` says no.
     * A pause after no answer ends when a browser is online again.
     */
    async wait(error, options = {}) {
        const now = Date.now();
        const since = (this.#since ??= now);
        const tooSoon = error.code === "rate_limited" && error.retryAfterS !== null;
        if (!tooSoon)
            this.#failures += 1;
        if (this.retries === 0 || this.#failures > this.retries)
            throw error;
        let pause = Math.min(FIRST_PAUSE_MS * 2 ** Math.max(this.#failures - 1, 0), LONGEST_PAUSE_MS) * (0.5 + 0.5 * Math.random());
        // At least as long as the service asks for, and not all at the same moment.
        const asked = Math.max(options.leastMs ?? 0, 1000 * (error.retryAfterS ?? 0));
        if (asked)
            pause = asked + 0.25 * pause;
        if (now + pause > since + this.timeoutMs)
            throw error;
        if (options.goesOn?.(this.#failures, pause) === false)
            throw error;
        await sleep(pause, options.signal, error.unanswered);
    }
}
/** Wait for some milliseconds, or until a browser is online again; throw when the signal aborts. */
function sleep(milliseconds, signal, untilOnline) {
    // Node.js has no such event.
    const network = untilOnline && typeof addEventListener === "function" ? globalThis : null;
    return new Promise((resolve, reject) => {
        signal?.throwIfAborted();
        const end = () => {
            clearTimeout(timer);
            signal?.removeEventListener("abort", end);
            network?.removeEventListener("online", end);
            if (signal?.aborted)
                reject(signal.reason);
            else
                resolve();
        };
        const timer = setTimeout(end, milliseconds);
        signal?.addEventListener("abort", end);
        network?.addEventListener("online", end);
    });
}
export class Transport {
    baseUrl;
    maxRetries;
    timeoutMs;
    directUploads;
    #apiKey;
    #fetch;
    #onRetry;
    #onUnauthorized;
    constructor(options) {
        const here = typeof location === "undefined" ? "http://127.0.0.1:8765" : location.origin;
        this.baseUrl = String(options.baseUrl ?? here).replace(/\/+$/, "");
        if (!/^https?:\/\/[^/]/.test(this.baseUrl))
            throw new TypeError(`${this.baseUrl} is not an address such as https://example.org.`);
        this.maxRetries = options.maxRetries ?? 4;
        this.timeoutMs = options.timeoutMs ?? 60_000;
        this.directUploads = options.directUploads ?? true;
        const key = options.apiKey ?? "";
        this.#apiKey = typeof key === "string" ? () => key : key;
        // Browsers refuse to call `fetch` as a method of another object.
        this.#fetch = options.fetch ?? ((input, init) => globalThis.fetch(input, init));
        this.#onRetry = options.onRetry;
        this.#onUnauthorized = options.onUnauthorized;
    }
    patience() {
        return new Patience(this.maxRetries, this.timeoutMs);
    }
    /** Return the address of a path of the service; paths that it names itself begin with a slash and lack the path of `baseUrl`. */
    url(path) {
        return /^https?:/.test(path) ? path : `${this.baseUrl}/${path.replace(/^\//, "")}`;
    }
    /** Return whether an address or path is one of the service. */
    isOwn(path) {
        return this.url(path).startsWith(`${this.baseUrl}/`);
    }
    /** Send a request, again if need be, and return the successful response. The request must be safe to repeat. */
    request(path, call = {}) {
        return this.read(path, call, async (response) => response);
    }
    /** Send a request and return the document of the answer. */
    json(path, call = {}) {
        return this.read(path, call, async (response) => (await response.json()));
    }
    /** Send a request, again if need be, and return what is taken from the successful response; one that breaks off is no answer. */
    async read(path, call, take) {
        const patience = this.patience();
        const method = call.method ?? "GET";
        const keyed = new Headers(call.headers).has("Idempotency-Key");
        const goesOn = (failures, pauseMs) => this.#onRetry?.(error, { method, path, keyed, failures, pauseMs }) !== false;
        let error;
        for (let lost = false;;) {
            try {
                const key = call.signed || !this.isOwn(path) ? "" : this.#apiKey();
                const response = await this.#send(path, call, key);
                // After a request that succeeded, and whose answer was lost.
                if (response.ok || (lost && method === "DELETE" && response.status === 404))
                    return await this.#taken(take(response), call);
                if (response.status === 401 && !call.signed && (await this.#onUnauthorized?.(key, call.signal)))
                    continue;
                error = await errorOf(response);
            }
            catch (failure) {
                if (!worthRetrying(failure))
                    throw failure;
                error = failure;
                lost = true;
            }
            if (call.once || !worthRetrying(error))
                throw error;
            await patience.wait(error, { signal: call.signal, goesOn });
        }
    }
    async #send(path, call, key) {
        const headers = new Headers(call.headers);
        if (key)
            headers.set("Authorization", `Bearer ${key}`);
        const init = { method: call.method ?? "GET", headers };
        if (call.json !== undefined) {
            headers.set("Content-Type", "application/json");
            init.body = JSON.stringify(call.json);
        }
        else if (call.body !== undefined)
            init.body = call.body;
        if (call.signal)
            init.signal = call.signal;
        if (call.keepalive)
            init.keepalive = true;
        return this.#taken(this.#fetch(this.url(path), init), call);
    }
    /** Return what comes from the network, or throw that it did not come. */
    async #taken(coming, call) {
        try {
            return await coming;
        }
        catch (failure) {
            call.signal?.throwIfAborted();
            const detail = `${this.baseUrl} does not answer.`;
            const advice = "Check the address of the service, and that it is running.";
            throw new MeshdeformError(0, { code: "unavailable", detail, advice }, null, { cause: failure });
        }
    }
}
/** Return a key for a request that may be repeated, and must be carried out once. */
export function newKey() {
    return [...crypto.getRandomValues(new Uint32Array(4))].map((word) => word.toString(16).padStart(8, "0")).join("");
}
