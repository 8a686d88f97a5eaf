// @ts-check
/** The worker that unfolds a field, as promises. */

export class FieldWorker {
  constructor() {
    this.worker = new Worker(new URL("field-worker.js", import.meta.url), { type: "module" });
    /** @type {Map<number, { resolve: (answer: any) => void, reject: (error: Error) => void }>} */
    this.open = new Map();
    this.last = 0;
    this.worker.addEventListener("message", ({ data: { id, error, ...answer } }) => {
      const waiting = this.open.get(id);
      this.open.delete(id);
      if (error) waiting?.reject(new Error(error));
      else waiting?.resolve(answer);
    });
    this.worker.addEventListener("error", (event) => {
      for (const { reject } of this.open.values()) reject(new Error(event.message || "The script that unfolds it could not be loaded."));
      this.open.clear();
    });
  }

  /**
   * @param {"open" | "level"} task
   * @param {Record<string, unknown>} given
   * @param {Transferable[]} [owned] what the worker gets for itself
   * @returns {Promise<any>} as the worker describes it
   */
  ask(task, given, owned = []) {
    const id = ++this.last;
    return new Promise((resolve, reject) => {
      this.open.set(id, { resolve, reject });
      this.worker.postMessage({ id, task, ...given }, owned);
    });
  }

  dispose() {
    this.worker.terminate();
    this.open.clear();
  }
}
