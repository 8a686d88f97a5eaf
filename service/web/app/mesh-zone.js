// @ts-check
/** Takes many mesh files: chosen, or dropped anywhere on the page. */
import { packMeshes } from "../client/index.js";
import { announce } from "./announce.js";
import { exampleAsset, formatOf, FORMATS } from "./assets.js";
import { button, fill, h, icon, say } from "./dom.js";
import { bytes, counted } from "./format.js";
import { fileInput, takeDrops } from "./picking.js";

/** What is drawn of what was chosen: so many, if all together are no larger. */
const DRAWN = 8;
const LARGEST_BYTES = 1 << 25;
const PICTURE = { width: 320, height: 320 };

export class MeshZone {
  /**
   * @param {import("./scope.js").Scope} scope
   * @param {object} options
   * @param {string} options.id
   * @param {string} options.hint
   * @param {string} options.empty
   * @param {string[]} [options.further] Names of other files that may come along, or how they end.
   * @param {string} options.sample A file of ours that is there until others come.
   * @param {(there: boolean) => void} [options.onSample] It has come, or has given way.
   */
  constructor(scope, { id, hint, empty, further = [], sample, onSample = () => {} }) {
    this.scope = scope;
    this.empty = empty;
    this.onSample = onSample;
    /** Whether what is there is the sample. */
    this.sampled = false;
    this.further = further;
    /** @type {File[]} */
    this.files = [];
    const accept = [...FORMATS.map((ending) => "." + ending), ...further, "model/gltf-binary", "application/zip"].join(",");
    this.file = fileInput(id, "Mesh files", accept, (files) => this._take(files), true);
    this.refused = h("div", { class: "field-problem", role: "alert", hidden: true });
    this.count = h("p", { class: "small muted", "aria-live": "polite" });
    this.list = h("ul", { class: "files", "aria-label": "Chosen meshes" });
    this.pictures = h("div", { class: "zone-pictures", "aria-hidden": "true" });
    this.element = h(
      "section",
      { class: "mesh-zone", "aria-label": "Meshes" },
      h("div", { class: "drop-veil", "aria-hidden": "true" }, icon("upload"), h("strong", null, "Drop them here")),
      h("div", { class: "row" }, button("Choose meshes", () => this.file.click(), { icon: "upload" }), this.file, this.count),
      h("p", { class: "small muted" }, hint),
      this.refused,
      this.pictures,
      this.list,
    );
    takeDrops(scope, this.element, (files) => this._take(files));
    this._draw();
    void this._sample(sample);
  }

  clear() {
    this._drop();
    this._draw();
  }

  /** @param {File[]} files */
  add(files) {
    if (this.sampled) this._drop();
    this.files = [...this.files, ...files];
    this._draw();
  }

  /** @param {string} name */
  async _sample(name) {
    const asset = await exampleAsset(name, this.scope.signal).catch(() => null); // all works without it
    if (!asset || this.scope.over || this.files.length) return;
    this.files = [new File([asset.blob], name)];
    this.sampled = true;
    this.onSample(true);
    this._draw();
  }

  _drop() {
    this.files = [];
    if (this.sampled) this.onSample(false);
    this.sampled = false;
  }

  /**
   * What to send: a ZIP of the files, or the only one if it is a ZIP.
   * @param {string} name Of the ZIP.
   * @returns {Promise<File>}
   */
  async packed(name) {
    const [first, ...more] = this.files;
    if (!more.length && formatOf(first.name) === "zip") return first;
    return new File([await packMeshes(this.files)], name, { type: "application/zip" });
  }

  /** Say what is wrong with the files; empty: nothing. @param {string} text */
  refuse(text) {
    say(this.refused, text);
    if (text) this.file.focus();
  }

  /** @param {File[]} files */
  _take(files) {
    const wrong = files.find((file) => !FORMATS.includes(formatOf(file.name)) && !this.further.some((end) => file.name.endsWith(end)));
    const there = this.sampled ? [] : this.files;
    const zip = [...there, ...files].some((file) => formatOf(file.name) === "zip");
    const refusal = wrong
      ? `${wrong.name} isn't supported. Use GLB, OBJ, PLY or STL, or a ZIP of them.`
      : zip && there.length + files.length > 1
        ? "Choose one ZIP, or any number of other files: not both."
        : "";
    say(this.refused, refusal);
    if (refusal) return;
    this.add(files);
    announce(`${counted(files.length, "file")} added`);
  }

  _draw() {
    const size = this.files.reduce((sum, file) => sum + file.size, 0);
    this.count.textContent = this.files.length ? `${this.sampled ? "A sample, until you choose yours: " : ""}${counted(this.files.length, "file")}, ${bytes(size)}` : this.empty;
    fill(this.list, this.files.map((file) => this._row(file)));
    fill(this.pictures);
    if (this.files.length && size <= LARGEST_BYTES) void this._picture(this.files);
  }

  /** @param {File[]} files */
  async _picture(files) {
    try {
      const [{ sorted }, { snapshotAssets }] = await Promise.all([import("./many/files.js"), import("../viewer/snapshot.js")]);
      const { assets } = await sorted(files.map((blob) => ({ path: blob.name, blob })));
      const drawn = await Promise.all(assets.slice(0, DRAWN).map(async ({ asset }) => ({ buffer: await asset.bytes(), format: /** @type {any} */ (asset.format || "gltf") })));
      if (files !== this.files || this.scope.over) return;
      const pictures = await snapshotAssets(drawn, PICTURE);
      if (files === this.files && !this.scope.over) fill(this.pictures, pictures.map((picture) => h("img", { src: this.scope.url(picture), alt: "" })));
    } catch {
      // It cannot be drawn, and is listed all the same.
    }
  }

  /** @param {File} file */
  _row(file) {
    const { name, size } = file;
    const remove = button(`Remove ${name}`, () => {
      if (this.sampled) this._drop();
      this.files = this.files.filter((other) => other !== file);
      this._draw();
    }, { icon: "cross", quiet: true, class: "button-quiet" });
    return h("li", { class: "file" }, h("div", null, h("strong", null, name), h("span", { class: "small muted" }, bytes(size))), remove);
  }
}
