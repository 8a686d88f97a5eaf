// @ts-check
/** Saves the shape that is shown: a result in every format that the server makes, any other shape as a GLB, also one that no job has. */
import { client } from "../client.js";
import { button, fill, h } from "../dom.js";
import { downloadMenu } from "../download-menu.js";
import { saveBytes } from "../job/files.js";
import { shapeName } from "../names.js";
import { orToast } from "../problem-box.js";

/**
 * @typedef {object} Shown
 * @property {import("./live.js").Shape} shape
 * @property {number} share Of the way to it.
 * @property {any} job Null where none is shown.
 * @property {boolean} result Whether the shape is the result of the job.
 */

export class Downloads {
  /**
   * @param {import("../scope.js").Scope} scope
   * @param {(signal: AbortSignal) => Promise<ArrayBuffer>} make The shape that no job has.
   * @param {() => any} named What names its file, as a job does.
   */
  constructor(scope, make, named) {
    this.scope = scope;
    this.make = make;
    this.named = named;
    /** @type {Shown | null} */
    this.shown = null;
    this.button = button("Download", () => this._save(), { icon: "download" });
    /** The formats of the result, once there is one. */
    this.menu = h("div", { hidden: true });
    this.element = h("div", { class: "downloads", hidden: true }, this.button, this.menu);
  }

  /** @param {any} job That has a result. @param {any[]} artifacts */
  offer(job, artifacts) {
    fill(this.menu, downloadMenu(job, artifacts, this.scope));
  }

  /** @param {Shown | null} shown */
  show(shown) {
    this.shown = shown;
    this.element.hidden = !shown;
    // The other formats are made of a result as it is stored.
    const whole = Boolean(shown?.result && shown.share === 1 && this.menu.firstChild);
    this.button.hidden = whole;
    this.menu.hidden = !whole;
  }

  _save() {
    const { shown, scope } = this;
    if (!shown) return;
    const { shape, share, job } = shown;
    return orToast("Not downloaded", async () => {
      const path = shape.stored && shape.stored.path + (share === 1 ? "" : `?strength=${share}`);
      const bytes = path ? await client.bytes(path, { signal: scope.signal }) : await this.make(scope.signal);
      saveBytes(new Blob([bytes], { type: "model/gltf-binary" }), shapeName(shape.stored ? job : this.named(), shape.stored?.name ?? "", Math.round(100 * share)));
    });
  }
}
