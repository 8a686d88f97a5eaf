// @ts-check
/** A place for many mesh files: chosen, or dropped anywhere on the page. */
import { packMeshes } from "../client/index.js";
import { announce } from "./announce.js";
import { formatOf, FORMATS } from "./assets.js";
import { button, fill, h, icon, say } from "./dom.js";
import { bytes, counted } from "./format.js";
import { fileInput, takeDrops } from "./picking.js";

export class MeshZone {
  /**
   * @param {import("./scope.js").Scope} scope
   * @param {{id: string, hint: string, empty: string, further?: string[]}} options `further`: names of other files that may come along.
   */
  constructor(scope, { id, hint, empty, further = [] }) {
    this.empty = empty;
    this.further = further;
    /** The files, each with a word for what it is. @type {{file: File, label: string}[]} */
    this.entries = [];
    /** @type {string[]} */
    this.labels = [];
    const accept = [...FORMATS.map((ending) => "." + ending), ...further, "model/gltf-binary", "application/zip"].join(",");
    this.file = fileInput(id, "Mesh files", accept, (files) => this._take(files), true);
    this.refused = h("div", { class: "field-problem", role: "alert", hidden: true });
    this.count = h("p", { class: "small muted", "aria-live": "polite" });
    this.list = h("ul", { class: "files teach-files", "aria-label": "Chosen meshes" });
    this.element = h(
      "section",
      { class: "teach-meshes", "aria-label": "Meshes" },
      h("div", { class: "drop-veil", "aria-hidden": "true" }, icon("upload"), h("strong", null, "Drop them here")),
      h("div", { class: "row" }, button("Choose meshes", () => this.file.click(), { icon: "upload" }), this.file, this.count),
      h("p", { class: "small muted" }, hint),
      this.refused,
      this.list,
    );
    takeDrops(scope, this.element, (files) => this._take(files));
    this._draw();
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
    const [{ file, label }, ...more] = this.entries;
    if (!more.length && !label && (alone || formatOf(file.name) === "zip")) return file;
    return new File([await packMeshes(this.entries)], name, { type: "application/zip" });
  }

  /** Say what is wrong with the files; empty: nothing. @param {string} text */
  refuse(text) {
    say(this.refused, text);
    if (text) this.file.focus();
  }

  /** @param {File[]} files */
  _take(files) {
    const wrong = files.find((file) => !FORMATS.includes(formatOf(file.name)) && !this.further.includes(file.name));
    const zip = [...this.files, ...files].some((file) => formatOf(file.name) === "zip");
    const refusal = wrong
      ? `${wrong.name} isn't supported. Use GLB, OBJ, PLY or STL, or a ZIP of them.`
      : zip && this.files.length + files.length > 1
        ? "Choose one ZIP, or any number of other files: not both."
        : "";
    say(this.refused, refusal);
    if (refusal) return;
    this.add(files);
    announce(`${counted(files.length, "file")} added`);
  }

  _draw() {
    const size = this.files.reduce((sum, file) => sum + file.size, 0);
    this.count.textContent = this.files.length ? `${counted(this.files.length, "file")}, ${bytes(size)}` : this.empty;
    fill(this.list, this.entries.map((entry) => this._row(entry)));
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
