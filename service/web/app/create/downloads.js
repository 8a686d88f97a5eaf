// @ts-check
/** Saves the shape that is shown: the file of a job in every format that the server makes, or the shape itself where no job has it yet. */
import { client } from "../client.js";
import { button, h, options } from "../dom.js";
import { arDevice } from "../../viewer/ar.js";
import { download, downloadMade, saveBytes, viewInRoom } from "../job/files.js";
import { artifactName, shapeName } from "../names.js";
import { orToast } from "../problem-box.js";

/** The formats of a result. @type {[string, string][]} */
const FORMATS = [["result.glb", "GLB"], ["result.usdz", "USDZ, for iPhones"], ["result.obj.zip", "OBJ"], ["result.3mf", "3MF, for printing"], ["result.stl", "STL"], ["morph.glb", "GLB, moving"]];

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
    /** Of the files that the job has. @type {string[]} */
    this.names = [];
    this.button = button("Download", () => this._save(), { icon: "download" });
    this.format = h("select", { class: "select-small", "aria-label": "Format" }, options(FORMATS));
    this.room = button("View in your room", () => this.shown && viewInRoom(this.shown.job, this.names, this.scope), { icon: "camera", quiet: true });
    this.element = h("div", { class: "joined downloads", hidden: true }, this.button, this.format, this.room);
  }

  /** @param {Shown | null} shown */
  show(shown) {
    this.shown = shown;
    this.element.hidden = !shown;
    // The other formats are made of a result as it is stored.
    const whole = Boolean(shown?.result && shown.share === 1);
    this.format.hidden = !whole;
    this.room.hidden = this.format.hidden || !arDevice();
    if (!whole) this.format.value = FORMATS[0][0];
    this.button.classList.toggle("button-primary", whole);
  }

  _save() {
    const { shown } = this;
    if (!shown) return;
    const { shape, share, job, result } = shown;
    if (result && share === 1) return this._saveResult(job, this.format.value);
    return orToast("Not downloaded", async () => {
      const { signal } = this.scope;
      const percent = Math.round(100 * share);
      const bytes = shape.stored ? await client.bytes(shape.stored.path + (share === 1 ? "" : `?strength=${share}`), { signal }) : await this.make(signal);
      saveBytes(new Blob([bytes], { type: "model/gltf-binary" }), shapeName(shape.stored ? job : this.named(), shape.stored?.name ?? "", percent));
    });
  }

  /** @param {any} job @param {string} name */
  _saveResult(job, name) {
    if (!this.names.includes(name)) return downloadMade(job, name, this.scope);
    return download(`v1/jobs/${job.id}/artifacts/${name}`, artifactName(job, name), job.asset?.size ?? 0, true, this.scope);
  }
}
