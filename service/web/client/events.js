/** Events of a job as they happen, each once and in order, over any number of connections. */
import { errorOf, MeshdeformError } from "./errors.js";
import { Patience, worthRetrying } from "./transport.js";
import { isTerminal } from "./types.js";
/** The service says something at least every 15 seconds. */
const SILENCE_MS = 45_000;
const RECONNECTING = 5;
/** Yield the events after a number, up to the one that ends the job. */
export async function* events(transport, job, options = {}) {
    const { signal, onConnection } = options;
    const patience = new Patience(transport.maxRetries ? Infinity : 0, options.timeoutMs ?? RECONNECTING * transport.timeoutMs);
    let after = options.after ?? 0;
    let askedMs = 0;
    for (;;) {
        const silence = new AbortController();
        const both = signal ? AbortSignal.any([signal, silence.signal]) : silence.signal;
        const timer = new Timer(() => silence.abort());
        let connected = false;
        let error;
        try {
            const headers = { Accept: "text/event-stream", "Last-Event-ID": String(after) };
            const response = await transport.request(`v1/jobs/${job}/events`, { headers, signal: both, once: true });
            if (response.status === 204 || !response.body)
                return;
            if (!response.headers.get("Content-Type")?.startsWith("text/event-stream"))
                throw await errorOf(response);
            connected = true;
            onConnection?.(true);
            for await (const found of messages(response.body, () => timer.restart())) {
                if (typeof found === "number") {
                    askedMs = found;
                    continue;
                }
                if (found.seq <= after)
                    continue;
                after = found.seq;
                patience.renew();
                timer.stop(); // the caller may take its time
                yield found;
                if (isTerminal(found.type))
                    return;
                timer.restart();
            }
            error = ended(job);
        }
        catch (failure) {
            signal?.throwIfAborted();
            // A connection that breaks in the middle of its body fails as a TypeError; one that was silent is aborted here.
            if (failure instanceof MeshdeformError && failure.status < 500 && !worthRetrying(failure))
                throw failure;
            error = failure instanceof MeshdeformError ? failure : ended(job);
        }
        finally {
            timer.stop();
            silence.abort();
        }
        onConnection?.(false);
        // A connection that was good is made again at once.
        await patience.wait(error, { signal, leastMs: connected ? 0 : askedMs });
    }
}
function ended(job) {
    return new MeshdeformError(0, { code: "unavailable", detail: `The stream of events of ${job} ended before the job did.` });
}
/** Runs an action unless it is restarted in time. */
class Timer {
    action;
    #timer;
    constructor(action) {
        this.action = action;
        this.restart();
    }
    restart() {
        this.stop();
        this.#timer = setTimeout(this.action, SILENCE_MS);
    }
    stop() {
        clearTimeout(this.#timer);
    }
}
/**
 * Yield the events of a stream of server-sent events (WHATWG HTML, section 9.2), and the milliseconds after which the service wants to
 * be asked again where it says so. `EventSource` cannot send a key.
 */
export async function* messages(body, alive = () => { }) {
    const reader = body.pipeThrough(new TextDecoderStream()).getReader();
    let rest = "";
    let data = [];
    try {
        for (;;) {
            const { done, value } = await reader.read();
            if (done)
                return;
            alive();
            rest += value;
            // A carriage return at the end may be half of a line's end.
            const whole = rest.endsWith("\r") ? rest.length - 1 : rest.length;
            const lines = rest.slice(0, whole).split(/\r\n|\n|\r/);
            rest = (lines.pop() ?? "") + rest.slice(whole);
            for (const line of lines) {
                if (line.startsWith("data:"))
                    data.push(line.slice(5).replace(/^ /, ""));
                else if (/^retry: ?\d+$/.test(line))
                    yield Number(line.slice(6));
                else if (line === "" && data.length) {
                    const event = document(data.join("\n"));
                    data = [];
                    if (event)
                        yield event;
                }
            }
        }
    }
    finally {
        await reader.cancel().catch(() => { });
    }
}
/** Return an event, or null for what only newer services send. */
function document(text) {
    try {
        const found = JSON.parse(text);
        return typeof found?.seq === "number" && typeof found.type === "string" ? found : null;
    }
    catch {
        return null;
    }
}
