// @ts-check
/** The meshes of a lesson, each with a word for what it is. */
import { packMeshes } from "../../client/index.js";
import { formatOf } from "../assets.js";
import { button, fill, h } from "../dom.js";
import { bytes } from "../format.js";

export class MeshList {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {{file: File, label: string}[]} */
    this.entries = [];
    /** @type {string[]} */
    this.labels = [];
    this.element = h("ul", { class: "files teach-files", "aria-label": "Chosen meshes" });
  }

  get files() {
    return this.entries.map(({ file }) => file);
  }

  /** @param {File[]} files */
  add(files) {
    this.entries.push(...files.map((file) => ({ file, label: "" })));
    this._draw();
  }

  /** Offer labels. @param {string[]} labels */
  offer(labels) {
    this.labels = labels;
    this._draw();
  }

  /**
   * What to send: the file itself, or a ZIP in which folders name the labels.
   * @param {string} name Of the ZIP.
   * @param {boolean} [alone] Whether a single mesh may be sent by itself.
   * @returns {Promise<File>}
   */
  async packed(name, alone = true) {
    const { entries } = this;
    const first = entries[0].file;
    if (entries.length === 1 && !entries[0].label && (alone || formatOf(first.name) === "zip")) return first;
    return new File([await packMeshes(entries)], name, { type: "application/zip" });
  }

  _draw() {
    fill(this.element, this.entries.map((entry) => this._row(entry)));
    this.onChange();
  }

  /** @param {{file: File, label: string}} entry */
  _row(entry) {
    const { name, size } = entry.file;
    const select = h("select", { "aria-label": `What ${name} is`, on: { change: () => (entry.label = select.value) } }, h("option", { value: "" }, "as it is"), this.labels.map((label) => h("option", { value: label }, label)));
    select.value = entry.label;
    const remove = button(`Remove ${name}`, () => {
      this.entries = this.entries.filter((other) => other !== entry);
      this._draw();
    }, { icon: "cross", quiet: true, class: "button-quiet" });
    // A ZIP has its own folders.
    const labelled = this.labels.length > 0 && formatOf(name) !== "zip";
    return h("li", { class: "file" }, h("div", null, h("strong", null, name), h("span", { class: "small muted" }, bytes(size))), h("div", { class: "row" }, labelled ? select : null, remove));
  }
}
