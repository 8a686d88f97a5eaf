// @ts-check
/** What a view holds and releases when it goes: requests, timers, listeners, object URLs, viewers. */

export class Scope {
  constructor() {
    this._abort = new AbortController();
    /** @type {(() => void)[]} */
    this._ends = [];
  }

  /** Aborted when the view goes. */
  get signal() {
    return this._abort.signal;
  }

  get over() {
    return this._abort.signal.aborted;
  }

  /** @param {() => void} end */
  add(end) {
    if (this.over) end();
    else this._ends.push(end);
  }

  /** @param {EventTarget} target @param {string} type @param {(event: any) => void} listener */
  listen(target, type, listener) {
    target.addEventListener(type, listener, { signal: this.signal });
  }

  /** An address of these bytes, good for as long as the view is there. @param {Blob} blob */
  url(blob) {
    const url = URL.createObjectURL(blob);
    this.add(() => URL.revokeObjectURL(url));
    return url;
  }

  /** Wait; false where the view has gone meanwhile. @param {number} milliseconds @returns {Promise<boolean>} */
  sleep(milliseconds) {
    return new Promise((resolve) => {
      if (this.over) return resolve(false);
      const timer = setTimeout(() => resolve(true), milliseconds);
      this.signal.addEventListener("abort", () => (clearTimeout(timer), resolve(false)), { once: true });
    });
  }

  dispose() {
    if (this.over) return;
    this._abort.abort();
    for (const end of this._ends.splice(0).reverse()) {
      try {
        end();
      } catch (error) {
        console.error(error);
      }
    }
  }
}

/** The same function, called once the calls have stopped for a while. @param {() => void} work @param {number} milliseconds @param {Scope} scope */
export function debounced(work, milliseconds, scope) {
  let timer = 0;
  scope.add(() => clearTimeout(timer));
  return () => {
    clearTimeout(timer);
    timer = window.setTimeout(() => !scope.over && work(), milliseconds);
  };
}
