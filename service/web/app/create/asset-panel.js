// @ts-check
/** The asset of a new job: dropped, chosen, or one of the examples, and shown at once. */
import { announce } from "../announce.js";
import { Asset, exampleAsset, formatOf, SURFACE_FORMATS } from "../assets.js";
import { button, chip, fill, h, icon } from "../dom.js";
import { LARGEST_BYTES } from "../drafts.js";
import { bytes, counted } from "../format.js";
import { fileInput, isField, openField, takeDrops } from "../picking.js";
import { plainWords } from "../plain.js";
import { SAMPLES } from "../samples.js";
import { drawnPicture } from "../widgets.js";
import { ViewerBox } from "../viewer-box.js";

const WORDS = "GLB, OBJ, PLY, STL, ZIP, XYZ, NPZ or safetensors file";
const ADVICE =
  "Use GLB, OBJ, PLY or STL, or a ZIP with one of them or a .gltf and its files; or points with normals (PLY, XYZ), a signed distance grid (NPZ) or a network (safetensors).";

export class AssetPanel {
  /** @param {import("../scope.js").Scope} scope @param {(asset: Asset | null) => void} onChange @param {boolean} [choosing] Whether another file can be chosen. */
  constructor(scope, onChange, choosing = true) {
    this.scope = scope;
    this.choosing = choosing;
    this.onChange = onChange;
    /** @type {Asset | null} */
    this.asset = null;
    /** That with triangles in the view. @type {Asset | null} */
    this.shown = null;
    /** Whether nothing can be drawn here, or not this. */
    this.flat = false;
    this.onShown = () => {};
    /** How often an asset was chosen: one that is still on its way when another is chosen is dropped. */
    this.choices = 0;
    /** Takes pictures, and what is dropped on it; null where nobody does. @type {((files: File[]) => void) | null} */
    this.guide = null;
    this.box = new ViewerBox("Asset", scope);
    this.box.tag.hidden = true;
    const accept = [...SURFACE_FORMATS.map((format) => "." + format), ".ndf", "model/gltf-binary", "application/zip"].join(",");
    this.input = fileInput("asset-file", "Asset file", accept, ([file]) => this.take(file));
    this.facts = h("p", { class: "facts", id: "asset-facts" });
    this.large = h("p", { class: "small muted", hidden: true }, `Over ${bytes(LARGEST_BYTES)}: after a reload, choose it again.`);
    this.problem = h("div", { class: "field-problem", role: "alert", hidden: true });
    this.below = h("div", { class: "stage-below" });
    this.examples = h("div", { class: "chips", role: "group", "aria-label": "Example assets" });
    this.stage = h("div", { class: "stage" });
    this.element = this._build();
    if (choosing) takeDrops(scope, this.element, (files, target) => {
      const aimed = target instanceof Element && target.closest("[data-drop='guide']");
      if (this.guide && (aimed || files[0].type.startsWith("image/"))) this.guide(files);
      else this.take(files[0]);
    });
  }

  _build() {
    for (const { name, label } of [...SAMPLES, { name: "sphere.glb", label: "Sphere" }]) {
      this.examples.append(chip(label, () => this.example(name), { small: false, "aria-pressed": "false", data: { name } }));
    }
    const choose = button("Choose a file", () => this.input.click(), { icon: "upload" });
    this.stage.append(
      this.box.element,
      h("div", { class: "drop-veil", "aria-hidden": "true" }, icon("upload"), h("strong", null, "Drop it here")),
      button("Reset view", () => [this.box, this.other].forEach((box) => box?.resetView()), { icon: "reset", quiet: true, class: "button-quiet stage-reset" }),
    );
    const words = h("p", { class: "small muted" }, h("span", { class: "with-mouse" }, `Or drop a ${WORDS} anywhere on this page.`), h("span", { class: "without-mouse" }, WORDS));
    return h(
      "section",
      { class: "asset-panel", "aria-label": "Asset" },
      this.stage,
      this.below,
      this.problem,
      h("div", { class: "row asset-bar" }, h("div", { class: "asset-file" }, this.facts, this.large, this.choosing ? words : null), this.choosing ? h("div", { class: "row" }, choose, this.input) : null),
      this.choosing ? h("div", { class: "row example-row" }, h("span", { class: "small muted" }, "Or start with"), this.examples) : null,
    );
  }

  /** Show another view beside that of the asset. @param {ViewerBox} box */
  besides(box) {
    this.other = box;
    box.element.dataset.drop = "guide";
    this.box.element.after(box.element);
  }

  /** Put something below the view. @param {HTMLElement} element */
  addBelow(element) {
    this.below.append(element);
  }

  /** @param {string} [name] */
  async example(name = SAMPLES[0].name) {
    const choice = ++this.choices;
    try {
      const asset = await exampleAsset(name, this.scope.signal);
      if (choice === this.choices) await this.use(asset);
    } catch (error) {
      if (!this.scope.over && choice === this.choices) this.refuse("The example could not be loaded.", error instanceof Error ? error.message : "");
    }
  }

  /** @param {File} file */
  async take(file) {
    if (isField(file)) return openField(file);
    this.choices += 1;
    const format = formatOf(file.name, SURFACE_FORMATS);
    if (!format) {
      this.refuse(`${file.name} isn't supported.`, ADVICE);
      return;
    }
    if (format === "gltf") {
      this.refuse(`${file.name} refers to other files.`, "Export it as a single .glb, or pack it and its files into a ZIP.");
      return;
    }
    await this.use(new Asset(file, file.name));
  }

  /** @param {Asset} asset */
  async use(asset) {
    this.asset = asset;
    this.refuse("");
    for (const chip of this.examples.children) {
      chip.setAttribute("aria-pressed", String(chip instanceof HTMLElement && chip.dataset.name === asset.name));
    }
    fill(this.facts, h("strong", null, asset.name), ` ${bytes(asset.size)}`);
    this.large.hidden = asset.size <= LARGEST_BYTES;
    await asset.learn();
    if (this.scope.over || this.asset !== asset) return;
    this.onChange(asset);
    const drawn = await asset.drawn();
    if (this.scope.over || this.asset !== asset) return;
    const found = drawn ? await this.box.load(await asset.bytes(), asset.format) : await this._undrawn();
    if (this.scope.over || this.asset !== asset) return;
    if (found) this.describe(found.triangles, found.vertices);
    this.shown = found ? asset : null;
    this.flat = found === null;
    this.onShown();
    announce(`${asset.name} loaded`);
  }

  /** Say that there is nothing to see of the file yet. @returns {Promise<null>} */
  async _undrawn() {
    await this.box.ready;
    this.box.viewer?.clear();
    const [title, text] =
      this.asset?.format === "3mf"
        ? ["A 3MF is not shown here", "You see it once it is deformed."]
        : ["No triangles to show", "Points, grids and networks are seen once they are fitted."];
    if (!this.box.failed) this.box.say(title, text, "info");
    return null;
  }

  /** @param {number} triangles @param {number} vertices @param {string[]} [more] @param {string[]} [warnings] What limits the result, in sentences. */
  describe(triangles, vertices, more = [], warnings = []) {
    const asset = this.asset;
    if (!asset) return;
    const sizes = triangles ? [counted(triangles, "triangle"), counted(vertices, "vertex", "vertices")] : vertices ? [counted(vertices, "point")] : [];
    const said = [...sizes, bytes(asset.size), ...more];
    fill(this.facts, h("strong", null, asset.name), h("span", { class: "muted" }, said.join(" · ")), ...warnings.map(plainWords).filter(Boolean).map((text) => h("span", null, text)));
  }

  /** Show a picture where nothing can be drawn. @param {Blob} picture */
  showPicture(picture) {
    this.stage.append(drawnPicture(this.scope, picture, "Before, above, and after, below, from four sides"));
  }

  /** @param {string} text Empty: all is well. @param {string} [advice] */
  refuse(text, advice = "") {
    this.problem.hidden = !text;
    const help = plainWords(advice);
    fill(this.problem, text ? h("strong", null, plainWords(text) || "This file cannot be used.") : null, help ? h("span", null, " ", help) : null);
  }
}
