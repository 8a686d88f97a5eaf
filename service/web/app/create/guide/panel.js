// @ts-check
/** Target meshes in place of the prompt, or pictures from one to four sides: alone, or beside it. */
import { announce } from "../../announce.js";
import { Asset, formatOf } from "../../assets.js";
import { errorsOf } from "../../client.js";
import { button, chip, fill, h, say } from "../../dom.js";
import { bytes } from "../../format.js";
import { plainWords } from "../../plain.js";
import { fieldOf } from "../../groups.js";
import { fileInput } from "../../picking.js";
import { guideFiles, guideProblem, isTarget, MOST_PICTURES, noGuide, GUIDE_PARAMS, targetsOf } from "./model.js";
import { PictureView } from "./picture-view.js";
import { askForSketch } from "./sketch-dialog.js";
import { TargetView } from "./target-view.js";

const PICTURES = /\.(png|jpe?g|webp)$/i;

export class GuidePanel {
  /**
   * @param {import("../asset-panel.js").AssetPanel} assets
   * @param {import("../../scope.js").Scope} scope
   * @param {() => void} onChange
   */
  constructor(assets, scope, onChange) {
    this.onChange = onChange;
    this.scope = scope;
    this.guide = noGuide();
    /** @type {Asset[]} */
    this.meshes = [];
    /** Of pictures. @type {Asset[]} */
    this.images = [];
    this.targets = new TargetView(assets, scope);
    this.pictures = new PictureView(assets, scope, this);
    this.input = fileInput("target-file", "Target mesh file", ".glb,.obj,.ply,.stl,.zip", (files) => this.take(files));
    this.pictureInput = fileInput("picture-file", "Picture file", "image/png,image/jpeg,image/webp", (files) => this.take(files), true);
    this.chooseTarget = chip("Fit to another mesh", () => this.input.click(), { small: false, title: "Choose a GLB, OBJ, PLY, STL or ZIP, or drop it here" });
    this.draw = chip("Draw it", () => askForSketch((mesh, as) => void (as === "asset" ? assets.take(mesh) : this._takeMesh(mesh)), scope), { small: false, title: "Draw the target, or the asset" });
    this.choosePicture = chip("Add a picture", () => this.pictureInput.click(), { small: false, title: "Choose a PNG, JPEG or WebP, or drop it anywhere" });
    this.body = h("div", { class: "guide-body" });
    this.problem = h("p", { class: "field-problem", role: "alert", hidden: true });
    this.element = h("div", { class: "field guide", data: { drop: "guide" } }, h("div", { class: "chips" }, this.chooseTarget, this.draw, this.choosePicture, this.input, this.pictureInput), this.body, this.problem);
    this._show();
  }

  /** Take files that were chosen or dropped. @param {File[]} files */
  take(files) {
    const pictures = files.filter(({ name }) => PICTURES.test(name));
    if (pictures.length) return this._takePictures(pictures);
    const wrong = files.find(({ name }) => !formatOf(name) || formatOf(name) === "gltf");
    if (wrong) return this._refuse(`${wrong.name} isn't supported. Use a GLB, OBJ, PLY, STL or ZIP as the target, or a PNG, JPEG or WebP as a picture.`);
    this._takeMesh(files[0]);
  }

  /** Take a mesh as the target. @param {File} file */
  _takeMesh(file) {
    this._begin();
    this._use([new Asset(file, file.name)]);
    announce(`${file.name} is the target`);
  }

  /** Forget what there was. */
  _begin() {
    this.guide = noGuide();
    this.images = [];
    this.meshes = [];
  }

  /** @param {File[]} files */
  _takePictures(files) {
    if (this.target) return this._refuse("A picture cannot guide beside a target mesh. Remove the target first.");
    for (const file of files) {
      if (this.images.length >= MOST_PICTURES) return this._refuse(`${MOST_PICTURES} pictures at most.`);
      this.images.push(new Asset(file, file.name));
      this.guide.pictures.push(this.pictures.direction(this.guide.pictures.length));
    }
    this._refuse("");
    this._changed();
    this.pictures.fit(this.images.length - 1);
    announce(`${files[0].name} added`);
  }

  /** @param {Asset[]} meshes The targets. */
  _use(meshes) {
    this.meshes = meshes;
    this.pictures.end();
    this._refuse("");
    this.targets.show(this.target);
    this._changed();
  }

  /** The first target mesh; null where there is none. */
  get target() {
    return this.meshes[0] ?? null;
  }

  /** Whether something besides a prompt says what to become. */
  get isEmpty() {
    return !this.target && !this.images.length;
  }

  /** @returns {Record<string, Asset>} by their names in a job */
  get files() {
    return guideFiles(this.meshes, this.images);
  }

  /** Return what the form holds, for a draft or a request. */
  value() {
    return { ...structuredClone(this.guide), targets: this.meshes.length };
  }

  /** @param {import("./model.js").Guide | null | undefined} guide As `value` gave it. @param {Record<string, Asset>} files */
  restore(guide, files) {
    const { pictures } = { ...noGuide(), ...structuredClone(guide ?? noGuide()) };
    this.meshes = targetsOf(files);
    this.images = Object.keys(files).filter((name) => name.startsWith("silhouette_")).sort().map((name) => files[name]);
    // Without its file, as after a reload with a large one, the rest means nothing.
    this.guide = { pictures: this.images.map((_, i) => pictures[i] ?? this.pictures.direction(i)) };
    this.pictures.end();
    this.targets.show(this.target);
    this._show();
  }

  /** @param {Asset} mesh */
  _remove(mesh) {
    this._use(this.meshes.filter((each) => each !== mesh));
    announce("Target removed");
  }

  /** @param {number} at */
  _removePicture(at) {
    this.pictures.end();
    this.images.splice(at, 1);
    this.guide.pictures.splice(at, 1);
    this._changed();
  }

  /** What came or went is shown, and the form told. */
  _changed() {
    this._show();
    this.onChange();
  }

  /** A picture has another direction. @param {number} at */
  turned(at) {
    const said = this.body.children[at]?.querySelector(".direction");
    if (said) said.textContent = directionWords(this.guide.pictures[at]);
    this.onChange();
  }

  _show() {
    this.chooseTarget.hidden = this.draw.hidden = !this.isEmpty;
    this.choosePicture.hidden = this.target !== null || this.images.length >= MOST_PICTURES;
    fill(this.body, this.target ? this.meshes.map((mesh) => this._targetRow(mesh)) : this.images.map((file, i) => this._pictureRow(file, i)));
  }

  /** @param {Asset} mesh */
  _targetRow(mesh) {
    const remove = button("Remove the target", () => this._remove(mesh), { icon: "trash", quiet: true, class: "button-quiet" });
    return h("div", { class: "row guide-head" }, h("strong", null, "Target mesh"), h("span", { class: "muted" }, `${mesh.name} · ${bytes(mesh.size)}`), remove);
  }

  /** @param {Asset} file @param {number} at */
  _pictureRow(file, at) {
    const fitting = this.pictures.fitting === at;
    const fit = chip(fitting ? "Done" : "Turn the asset to fit", () => (fitting ? this.pictures.end() : this.pictures.fit(at)), { "aria-pressed": String(fitting) });
    fit.hidden = !this.pictures.possible;
    const image = h("img", { src: this.pictures.url(file), alt: "" });
    return h(
      "div",
      { class: "control-row picture-row", role: "group", "aria-label": `Picture ${at + 1}` },
      image,
      h(
        "div",
        null,
        h("div", { class: "control-head" }, h("strong", null, file.name), button(`Remove picture ${at + 1}`, () => this._removePicture(at), { icon: "trash", quiet: true, class: "button-quiet" })),
        h("p", { class: "small muted direction" }, directionWords(this.guide.pictures[at])),
        fit,
      ),
    );
  }

  /** @param {string} text Empty: all is well. */
  _refuse(text) {
    say(this.problem, text);
  }

  /** Return whether it can be sent; what cannot is said. */
  check() {
    const problem = guideProblem(this.guide);
    this._refuse(problem);
    return !problem;
  }

  /** Say what the server refuses beside it. @param {import("../../client.js").MeshdeformError} error @returns {boolean} whether it belongs here */
  refuse(error) {
    const errors = errorsOf(error);
    const isOurs = (/** @type {string} */ file) => isTarget(file) || file.startsWith("silhouette");
    const own = errors.length > 0 && errors.every((each) => GUIDE_PARAMS.includes(fieldOf(each)[0]) || isOurs(String(each.loc?.[0] ?? "")));
    const file = String(error.problem.part ?? error.problem.file ?? "");
    if (this.isEmpty || !(own || isOurs(file) || error.code.startsWith("silhouette"))) return false;
    this._refuse(plainWords([error.message, error.advice].filter(Boolean).join(" ")) || error.title);
    return true;
  }

  focusProblem() {
    /** @type {HTMLElement | null} */ (this.element.querySelector("button:not([hidden])"))?.focus();
  }
}

/** From where a picture shows the asset. @param {import("./model.js").Direction} direction */
function directionWords({ azimuth, elevation }) {
  return `Seen from ${azimuth}°${elevation ? `, ${elevation}° ${elevation > 0 ? "above" : "below"}`.replace("-", "") : ""}`;
}
