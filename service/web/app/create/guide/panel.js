// @ts-check
/** Target meshes in place of the prompt, or pictures from one to four sides: alone, or beside it. */
import { announce } from "../../announce.js";
import { Asset, formatOf } from "../../assets.js";
import { errorsOf } from "../../client.js";
import { button, fill, h, say } from "../../dom.js";
import { bytes } from "../../format.js";
import { plainWords } from "../../plain.js";
import { placeOf } from "../../groups.js";
import { fileInput } from "../../picking.js";
import { numberField, placeFields } from "../control/rows.js";
import { guideFiles, guideProblem, isTarget, MOST_PICTURES, MOST_TARGETS, noGuide, GUIDE_PARAMS, targetsOf } from "./model.js";
import { PictureView } from "./picture-view.js";
import { askForSketch } from "./sketch-dialog.js";
import { TargetView } from "./target-view.js";

const PICTURES = /\.(png|jpe?g|webp)$/i;

export class GuidePanel {
  /**
   * @param {import("../asset-panel.js").AssetPanel} assets
   * @param {import("../control/view.js").ControlView} control
   * @param {import("../../scope.js").Scope} scope
   * @param {() => void} onChange
   */
  constructor(assets, control, scope, onChange) {
    this.onChange = onChange;
    this.scope = scope;
    this.guide = noGuide();
    /** @type {Asset[]} */
    this.meshes = [];
    /** That in the view. @type {Asset | null} */
    this.seen = null;
    /** Whether there may be several, of which the nearest is taken. */
    this.several = false;
    /** @type {Asset[]} */
    this.files = [];
    this.targets = new TargetView(assets, control, scope, this);
    this.pictures = new PictureView(assets, scope, this);
    /** @type {(() => void)[]} */
    this.shows = [];
    this.input = fileInput("target-file", "Target mesh file", ".glb,.obj,.ply,.stl,.zip", (files) => this.take(files), true);
    this.pictureInput = fileInput("picture-file", "Picture file", "image/png,image/jpeg,image/webp", (files) => this.take(files), true);
    this.chooseTarget = button("Fit to another mesh", () => this.input.click(), { class: "chip", title: "Choose a GLB, OBJ, PLY, STL or ZIP, or drop it here" });
    this.draw = button("Draw it", () => askForSketch((mesh, part) => void (part === "asset" ? assets.take(mesh) : this._takeMesh(mesh)), scope), { class: "chip", title: "Draw the target, or the asset" });
    this.choosePicture = button("Add a picture", () => this.pictureInput.click(), { class: "chip", title: "Choose a PNG, JPEG or WebP, or drop it anywhere" });
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
    for (const file of this.several ? files : files.slice(0, 1)) this._takeMesh(file);
  }

  /** Take a mesh as the target; where there may be several, as a further one. @param {File} file */
  _takeMesh(file) {
    const further = this.several && this.target !== null;
    if (further && this.meshes.length >= MOST_TARGETS) return this._refuse(`${MOST_TARGETS} target meshes at most.`);
    if (!further) this._begin();
    const mesh = new Asset(file, file.name);
    this._use([...this.meshes, mesh], mesh);
    announce(`${file.name} is ${further ? `target ${this.meshes.length}` : "the target"}`);
  }

  /** Forget what there was. */
  _begin() {
    this.guide = noGuide();
    this.files = [];
    this.meshes = [];
  }

  /** @param {File[]} files */
  _takePictures(files) {
    if (this.target) return this._refuse("A picture cannot guide beside a target mesh. Remove the target first.");
    for (const file of files) {
      if (this.files.length >= MOST_PICTURES) return this._refuse(`${MOST_PICTURES} pictures at most.`);
      this.files.push(new Asset(file, file.name));
      this.guide.pictures.push(this.pictures.direction(this.guide.pictures.length));
    }
    this._refuse("");
    this._changed();
    this.pictures.fit(this.files.length - 1);
    announce(`${files[0].name} added`);
  }

  /** @param {Asset[]} meshes The targets. @param {Asset | null} seen That in the view. */
  _use(meshes, seen) {
    this.meshes = meshes;
    this.pictures.end();
    this._refuse("");
    this._see(seen);
    this._changed();
  }

  /** @param {Asset | null} mesh To be in the view. */
  _see(mesh) {
    this.seen = mesh;
    this.targets.show(mesh);
  }

  /** The first target mesh; null where there is none. */
  get target() {
    return this.meshes[0] ?? null;
  }

  /** The pairs of points, which are on the only target. */
  get pairs() {
    return this.meshes.length === 1 ? this.guide.landmarks : [];
  }

  /** @param {boolean} on Whether there may be several targets. */
  suit(on) {
    if (this.several === on) return;
    this.several = on;
    this._show();
  }

  /** Whether something besides a prompt says what to become. */
  get isEmpty() {
    return !this.target && !this.files.length;
  }

  /** @returns {Record<string, Asset>} by the names of their parts */
  get parts() {
    return guideFiles(this.meshes, this.files);
  }

  /** Return what the form holds, for a draft or a request. */
  value() {
    return { ...structuredClone(this.guide), targets: this.meshes.length };
  }

  /** @param {import("./model.js").Guide | null | undefined} guide As `value` gave it. @param {Record<string, Asset>} files */
  restore(guide, files) {
    const { align, landmarks, pictures } = { ...noGuide(), ...structuredClone(guide ?? noGuide()) };
    this.meshes = targetsOf(files);
    this.files = Object.keys(files).filter((name) => name.startsWith("silhouette_")).sort().map((name) => files[name]);
    // Without its file, as after a reload with a large one, the rest means nothing.
    this.guide = { align: this.target ? align : "", landmarks: this.target ? landmarks : [], pictures: this.files.map((_, i) => pictures[i] ?? this.pictures.direction(i)) };
    this.pictures.end();
    this._see(this.target);
    this._show();
  }

  /** @param {Asset} mesh */
  _remove(mesh) {
    // The pairs of points are on the first one.
    if (mesh === this.target) this.guide.landmarks = [];
    const others = this.meshes.filter((each) => each !== mesh);
    if (!others.length) this._begin();
    this._use(others, mesh === this.seen ? (others[0] ?? null) : this.seen);
    announce("Target removed");
  }

  /** @param {number} at */
  _removePicture(at) {
    this.pictures.end();
    this.files.splice(at, 1);
    this.guide.pictures.splice(at, 1);
    this._changed();
  }

  /** What came or went is shown, and the form told. */
  _changed() {
    this._show();
    this.onChange();
  }

  /** A value is another one. */
  changed() {
    for (const show of this.shows) show();
    this.targets.draw();
    this.onChange();
  }

  _show() {
    this.shows = [];
    const more = this.several && this.target !== null;
    this.chooseTarget.hidden = this.draw.hidden = more ? this.meshes.length >= MOST_TARGETS : !this.isEmpty;
    this.chooseTarget.textContent = more ? "Add another mesh" : "Fit to another mesh";
    this.choosePicture.hidden = this.target !== null || this.files.length >= MOST_PICTURES;
    this.targets.draw();
    fill(this.body, this.target ? this._targetFields() : this.files.map((file, i) => this._pictureRow(file, i)));
  }

  _targetFields() {
    const several = this.meshes.length > 1;
    const align = h(
      "select",
      { id: "target-align" },
      [["", "Turned, moved and scaled to fit"], ["none", "As the files have it"]].map(([value, text]) => h("option", { value }, text)),
    );
    align.value = this.guide.align === "auto" ? "" : this.guide.align;
    align.addEventListener("change", () => {
      this.guide.align = align.value;
      this.changed();
    });
    const pairs = h("button", { type: "button", class: "chip", "aria-pressed": String(this.targets.pairing), on: { click: () => this.targets.pair(!this.targets.pairing) } }, "Click pairs of points");
    pairs.hidden = !this.targets.possible;
    const add = button("Add a pair", () => this.addPair(this.targets.places), { class: "chip" });
    return [
      ...this.meshes.map((mesh, i) => this._targetRow(mesh, several ? ` ${i + 1}` : "")),
      h("label", { class: "field-label", for: "target-align" }, "Alignment"),
      align,
      several ? h("p", { class: "small muted" }, "The one that is nearest to your asset is taken.") : h("div", { class: "chips" }, pairs, add),
      this.targets.hint,
      this.pairs.length ? h("ul", { class: "control-rows", "aria-label": "Pairs of points" }, this.pairs.map((pair, i) => this._pairRow(pair, i))) : null,
    ];
  }

  /** @param {Asset} mesh @param {string} number Among several, with a space before it. */
  _targetRow(mesh, number) {
    const look = () => {
      this._see(mesh);
      this._show();
    };
    const see = h("button", { type: "button", class: "chip chip-small", "aria-pressed": String(mesh === this.seen), "aria-label": `Show target${number}`, on: { click: look } }, "Show");
    const remove = button(number ? `Remove target${number}` : "Remove the target", () => this._remove(mesh), { icon: "trash", quiet: true, class: "button-quiet" });
    return h("div", { class: "row guide-head" }, h("strong", null, number ? `Target${number}` : "Target mesh"), h("span", { class: "muted" }, `${mesh.name} · ${bytes(mesh.size)}`), number ? see : null, remove);
  }

  /** @param {import("./model.js").Landmark} pair */
  addPair(pair) {
    this.guide.landmarks.push(pair);
    this._changed();
  }

  /** @param {import("./model.js").Landmark} pair @param {number} at */
  _pairRow(pair, at) {
    const side = (/** @type {"source" | "target"} */ name, /** @type {string} */ label) => {
      if (!Array.isArray(pair[name])) return h("p", { class: "small muted" }, `${label}: vertex ${pair[name]}`);
      const fields = placeFields(label, () => /** @type {number[]} */ (pair[name]), (place) => {
        pair[name] = place;
        this.changed();
      });
      this.shows.push(fields.show);
      return fields.element;
    };
    const words = `Pair ${at + 1}`;
    const remove = () => {
      this.guide.landmarks.splice(at, 1);
      this._changed();
    };
    return h("li", { class: "control-row", "aria-label": words }, h("div", { class: "control-head" }, h("strong", null, words), button(`Remove pair ${at + 1}`, remove, { icon: "trash", quiet: true, class: "button-quiet" })), side("source", "Asset"), side("target", "Target"));
  }

  /** @param {Asset} file @param {number} at */
  _pictureRow(file, at) {
    const view = this.guide.pictures[at];
    const angle = (/** @type {"azimuth" | "elevation"} */ name, /** @type {string} */ label) => {
      const field = numberField(`${label} of picture ${at + 1}, degrees`, () => view[name], (value) => {
        view[name] = value;
        this.changed();
      });
      this.shows.push(field.show);
      return h("label", null, h("span", { class: "small muted" }, label), field.input);
    };
    const fit = h("button", { type: "button", class: "chip chip-small", "aria-pressed": String(this.pictures.fitting === at), on: { click: () => (this.pictures.fitting === at ? this.pictures.end() : this.pictures.fit(at)) } }, this.pictures.fitting === at ? "Done" : "Turn the asset to fit");
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
        h("div", { class: "angles" }, angle("azimuth", "Azimuth"), angle("elevation", "Elevation")),
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
    const wrong = this.element.querySelector('[aria-invalid="true"]');
    this._refuse(problem);
    return !problem && !wrong;
  }

  /** Say what the server refuses beside it. @param {import("../../client.js").MeshdeformError} error @returns {boolean} whether it belongs here */
  refuse(error) {
    const errors = errorsOf(error);
    const own = errors.length > 0 && errors.every((/** @type {any} */ each) => GUIDE_PARAMS.includes(placeOf(each)[0]) || isTarget(String(each.loc?.[0] ?? "")) || /^silhouette_\d$/.test(String(each.loc?.[0] ?? "")));
    const part = String(error.problem.part ?? error.problem.file ?? "");
    if (this.isEmpty || !(own || isTarget(part) || part.startsWith("silhouette") || error.code.startsWith("silhouette"))) return false;
    this._refuse(plainWords([error.message, error.advice].filter(Boolean).join(" ")) || error.title);
    return true;
  }

  focusProblem() {
    /** @type {HTMLElement | null} */ (this.element.querySelector('[aria-invalid="true"]') ?? this.element.querySelector("button:not([hidden])"))?.focus();
  }
}
