/** Events of a job as they happen, each once and in order, over any number of connections. */
import { errorOf, MeshdeformError } from "./errors.js";
import { Patience, type Transport, worthRetrying } from "./transport.js";
import { isTerminal, type JobEvent } from "./types.js";

/** The service says something at least every 15 seconds. */
const SILENCE_MS = 45_000;
const RECONNECTING = 5;

/** Yield the events after a number, up to the one that ends the job. */
export async function* events(transport: Transport, job: string, after: number, signal?: AbortSignal): AsyncGenerator<JobEvent> {
  const patience = new Patience(transport.maxRetries ? Infinity : 0, RECONNECTING * transport.timeoutMs);
  for (;;) {
    const silence = new AbortController();
    const both = signal ? AbortSignal.any([signal, silence.signal]) : silence.signal;
    const timer = new Timer(() => silence.abort());
    let error: MeshdeformError;
    try {
      const headers = { Accept: "text/event-stream", "Last-Event-ID": String(after) };
      const response = await transport.request(`v1/jobs/${job}/events`, { headers, signal: both, once: true });
      if (response.status === 204 || !response.body) return;
      if (!response.headers.get("Content-Type")?.startsWith("text/event-stream")) throw await errorOf(response);
      for await (const event of parsed(response.body, () => timer.restart())) {
        if (event.seq <= after) continue;
        after = event.seq;
        patience.renew();
        timer.stop(); // the caller may take its time
        yield event;
        if (isTerminal(event.type)) return;
        timer.restart();
      }
      error = ended(job);
    } catch (failure) {
      signal?.throwIfAborted();
      // A connection that breaks in the middle of its body fails as a TypeError; one that was silent is aborted here.
      if (failure instanceof MeshdeformError && !worthRetrying(failure)) throw failure;
      error = failure instanceof MeshdeformError ? failure : ended(job);
    } finally {
      timer.stop();
      silence.abort();
    }
    await patience.wait(error, signal);
  }
}

function ended(job: string): MeshdeformError {
  return new MeshdeformError(0, { code: "unavailable", detail: `The stream of events of ${job} ended before the job did.` });
}

/** Runs an action unless it is restarted in time. */
class Timer {
  #timer: ReturnType<typeof setTimeout> | undefined;

  constructor(private readonly action: () => void) {
    this.restart();
  }

  restart(): void {
    this.stop();
    this.#timer = setTimeout(this.action, SILENCE_MS);
  }

  stop(): void {
    clearTimeout(this.#timer);
  }
}

/** Yield the documents of a stream of server-sent events (WHATWG HTML, section 9.2). */
async function* parsed(body: ReadableStream<Uint8Array>, alive: () => void): AsyncGenerator<JobEvent> {
  const reader = body.pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array>).getReader();
  let rest = "";
  let data: string[] = [];
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      alive();
      rest += value;
      // A carriage return at the end may be half of a line's end.
      const whole = rest.endsWith("\r") ? rest.length - 1 : rest.length;
      const lines = rest.slice(0, whole).split(/\r\n|\n|\r/);
      rest = (lines.pop() ?? "") + rest.slice(whole);
      for (const line of lines) {
        if (line.startsWith("data:")) data.push(line.slice(5).replace(/^ /, ""));
        else if (line === "" && data.length) {
          const event = document(data.join("\n"));
          data = [];
          if (event) yield event;
        }
      }
    }
  } finally {
    await reader.cancel().catch(() => {});
  }
}

/** Return an event, or null for what only newer services send. */
function document(text: string): JobEvent | null {
  try {
    const found = JSON.parse(text);
    return typeof found?.seq === "number" && typeof found.type === "string" ? found : null;
  } catch {
    return null;
  }
}
