// @ts-check
/** A place for many mesh files: chosen, or dropped anywhere on the page. */
import { announce } from "./announce.js";
import { formatOf } from "./assets.js";
import { button, fill, h, icon } from "./dom.js";
import { bytes, counted } from "./format.js";
import { MeshList } from "./teach/mesh-list.js";

const ENDINGS = ["glb", "obj", "ply", "stl", "zip"];

export class MeshZone {
  /**
   * @param {import("./scope.js").Scope} scope
   * @param {{id: string, hint: string, empty: string, further?: string[]}} options `further`: names of other files that may come along.
   */
  constructor(scope, { id, hint, empty, further = [] }) {
    this.empty = empty;
    this.further = further;
    this.meshes = new MeshList(() => this._count());
    this.file = h("input", {
      type: "file", multiple: true, class: "visually-hidden", id, tabindex: "-1", "aria-label": "Mesh files",
      accept: [...ENDINGS.map((ending) => "." + ending), ...further, "model/gltf-binary", "application/zip"].join(","),
    });
    this.refused = h("div", { class: "field-problem", role: "alert", hidden: true });
    this.count = h("p", { class: "small muted", "aria-live": "polite" });
    this.element = h(
      "section",
      { class: "teach-meshes", "aria-label": "Meshes" },
      h("div", { class: "drop-veil", "aria-hidden": "true" }, icon("upload"), h("strong", null, "Drop them here")),
      h("div", { class: "row" }, button("Choose meshes", () => this.file.click(), { icon: "upload" }), this.file, this.count),
      h("p", { class: "small muted" }, hint),
      this.refused,
      this.meshes.element,
    );
    this._wire(scope);
    this._count();
  }

  get files() {
    return this.meshes.files;
  }

  /** Say what is wrong with the files; empty: nothing. @param {string} text */
  refuse(text) {
    this.refused.hidden = !text;
    fill(this.refused, text);
    if (text) this.file.focus();
  }

  /** @param {import("./scope.js").Scope} scope */
  _wire(scope) {
    const { file, element } = this;
    scope.listen(file, "change", () => {
      this._take([...(file.files ?? [])]);
      file.value = "";
    });
    const carries = (/** @type {DragEvent} */ event) => event.dataTransfer?.types.includes("Files") ?? false;
    scope.listen(document, "dragover", (event) => {
      if (!carries(event)) return;
      event.preventDefault();
      element.classList.add("dropping");
    });
    scope.listen(document, "dragleave", (event) => event.relatedTarget ?? element.classList.remove("dropping"));
    scope.listen(document, "drop", (event) => {
      element.classList.remove("dropping");
      if (!carries(event)) return;
      event.preventDefault();
      this._take([...(event.dataTransfer?.files ?? [])]);
    });
  }

  /** @param {File[]} files */
  _take(files) {
    const wrong = files.find((file) => !ENDINGS.includes(formatOf(file.name)) && !this.further.includes(file.name));
    const zip = [...this.files, ...files].some((file) => formatOf(file.name) === "zip");
    const refusal = wrong
      ? `${wrong.name} isn't supported. Use GLB, OBJ, PLY or STL, or a ZIP of them.`
      : zip && this.files.length + files.length > 1
        ? "Choose one ZIP, or any number of other files: not both."
        : "";
    this.refused.hidden = !refusal;
    fill(this.refused, refusal);
    if (refusal) return;
    this.meshes.add(files);
    announce(`${counted(files.length, "file")} added`);
  }

  _count() {
    const size = this.files.reduce((sum, file) => sum + file.size, 0);
    this.count.textContent = this.files.length ? `${counted(this.files.length, "file")}, ${bytes(size)}` : this.empty;
  }
}
