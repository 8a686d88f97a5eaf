// @ts-check
/** The page without a server, for any web host: the examples, and a job that was recorded (docs/generation/demo.py). */

const { demo } = globalThis.document?.documentElement?.dataset ?? {};

/** Whether there is no server. */
export const DEMO = demo !== undefined;

/** How long the job is played, however long it took. */
const PLAY_MS = Number(demo);

/** How far the recorded job has been played: its newest step, and whether it is over. */
const played = { step: 0, over: false };

/** Let the recorded job begin again. */
export function rewind() {
  Object.assign(played, { step: 0, over: false });
}

/**
 * Answer as the service did: what `recorded/` has of it, and of the job only what has been played.
 * @param {RequestInfo | URL} input
 * @param {RequestInit} [init]
 * @returns {Promise<Response>}
 */
export async function recordedFetch(input, init = {}) {
  const path = String(input).replace(document.baseURI.replace(/[^/]*([?#].*)?$/, ""), "");
  if (!path.startsWith("v1/")) return fetch(input, init);
  const name = path.replace(/\?.*/, "").replaceAll("/", "~");
  const response = init.method === "GET" ? await fetch(`recorded/${name}`, { signal: init.signal ?? null }) : new Response(null, { status: 404 });
  if (!response.ok) return response;
  if (name.endsWith("~events")) return new Response(replayed((await response.json()).events), { headers: { "Content-Type": "text/event-stream" } });
  if (/^v1~jobs~\w+$/.test(name) && !played.over) return Response.json({ ...(await response.json()), state: "queued" });
  if (name.endsWith("~checkpoints")) {
    const { checkpoints, ...rest } = await response.json();
    return Response.json({ ...rest, checkpoints: checkpoints.filter((/** @type {{step: number}} */ { step }) => played.over || step <= played.step) });
  }
  return response;
}

/** The events of a job as a stream, one after the other. @param {any[]} events @returns {ReadableStream<Uint8Array>} */
function replayed(events) {
  let next = 0;
  return new ReadableStream({
    async pull(controller) {
      if (next === events.length) return controller.close();
      await new Promise((resolve) => setTimeout(resolve, next ? PLAY_MS / events.length : 0));
      const event = events[next++];
      played.over = next === events.length;
      played.step = event.data.step ?? played.step;
      controller.enqueue(new TextEncoder().encode(`data: ${JSON.stringify(event)}\n\n`));
    },
  });
}
