// @ts-check
/** Draw what the asset should become: the service guesses it, its sliders are moved, and its mesh is the target, or the asset. */
import { announce } from "../../announce.js";
import { bytesOf, exampleAsset } from "../../assets.js";
import { client, isAbort } from "../../client.js";
import { openDialog } from "../../dialogs.js";
import { button, chip, fill, h } from "../../dom.js";
import { titled } from "../../format.js";
import { fileInput } from "../../picking.js";
import { problemBox } from "../../problem-box.js";
import { Scope } from "../../scope.js";
import { ViewerBox } from "../../viewer-box.js";
import { SketchPad } from "./sketch-pad.js";

const PAUSE_MS = 250;

/** @param {string} noun @returns {File} */
function meshFile(/** @type {BlobPart} */ bytes, noun) {
  return new File([bytes], `${noun}.glb`, { type: "model/gltf-binary" });
}

class SketchDialog {
  /** @param {(mesh: File, as: "target" | "asset") => void} use */
  constructor(use) {
    this.use = use;
    this.scope = new Scope();
    /** Of the sliders under way. */
    this.asking = new AbortController();
    /** @type {File | null} */
    this.mesh = null;
    this.pad = new SketchPad(() => this._changed());
    this.problem = h("div", { class: "dialog-problem", "aria-live": "polite" });
    this.guesses = h("div", { class: "sketch-guesses", role: "radiogroup", "aria-label": "Guesses" });
    this.fields = h("div", { class: "sketch-fields", role: "group", "aria-label": "Sliders" });
    this.view = h("div", { class: "sketch-view" });
    this.input = fileInput("sketch-file", "Drawing file", "image/png,image/jpeg,image/webp", ([file]) => this._take(file));
    this.undo = chip("Undo", () => this.pad.undo(), { small: false });
    this.clear = chip("Clear", () => this.pad.clear(), { small: false });
    this.name = h("input", { type: "text", "aria-label": "What it is", placeholder: "What it is, if you like", maxlength: 64, autocomplete: "off" });
    this.guess = button("Guess what it is", () => this._guess());
    this.deform = button("Use as asset", () => this._use("asset"));
    this.done = button("Use as target", () => this._use("target"), { class: "button-primary" });
    const drawing = h("div", null, this.pad.element, h("div", { class: "chips" }, this.undo, this.clear, chip("Choose a picture", () => this.input.click(), { small: false }), this.input, this.name, this.guess));
    this.element = openDialog(
      "Draw a shape",
      [
        h("p", { class: "small muted" }, "The outlines of one thing, an animal or a tool or anything else with a name, from the side or the front. Or drop a picture of a drawing. The chair is a sample: draw, and it goes."),
        h("div", { class: "sketch-columns" }, drawing, h("div", null, this.problem, this.guesses, this.view, this.fields)),
        h("div", { class: "dialog-actions" }, button("Cancel", () => this.element.close()), this.deform, this.done),
      ],
      this.scope,
      "sketch-dialog",
    );
    this.element.addEventListener("dragover", (event) => event.preventDefault());
    this.element.addEventListener("drop", (event) => {
      event.preventDefault();
      event.stopPropagation();
      this._take(event.dataTransfer?.files[0]);
    });
    this.element.addEventListener("close", () => this.scope.dispose());
    this.scope.add(() => this.asking.abort());
    this._changed();
    void this._sample();
  }

  /** Nothing opens empty. */
  async _sample() {
    const asset = await exampleAsset("drawing.png", this.scope.signal).catch(() => null); // all works without it
    if (asset && !this.scope.over) await this.pad.take(asset.blob, true);
  }

  /** @param {File | undefined} file */
  async _take(file) {
    if (file && !(await this.pad.take(file))) fill(this.problem, h("p", null, `${file.name} is no picture. Use a PNG, JPEG or WebP.`));
  }

  /** The drawing is another one: what was guessed is out of date. */
  _changed() {
    this.asking.abort();
    this.mesh = null;
    fill(this.problem);
    fill(this.guesses);
    fill(this.fields);
    this.view.hidden = true;
    this._enable();
  }

  _enable() {
    this.undo.disabled = this.clear.disabled = this.guess.disabled = this.pad.isEmpty;
    this.deform.disabled = this.done.disabled = !this.mesh;
  }

  /** A request that ends those before it. */
  _turn() {
    this.asking.abort();
    this.asking = new AbortController();
    return this.asking.signal;
  }

  async _guess() {
    const signal = this._turn();
    this.guess.disabled = true;
    fill(this.problem, h("p", { class: "muted" }, "Looking…"));
    try {
      const found = await client.guessSketch(await this.pad.png(), { noun: this.name.value.trim() || undefined, signal });
      if (signal.aborted) return;
      fill(this.problem, found.unsure ? h("p", null, "This may be something else. Choose one below, name it, or draw more of it.") : null);
      fill(this.guesses, found.guesses.map((each, i) => this._card(each, i === 0)));
      this._choose(found.guesses[0]);
      announce(`This may be: ${found.guesses[0].noun}`);
    } catch (error) {
      if (!isAbort(error) && !signal.aborted) fill(this.problem, problemBox(error));
    } finally {
      this._enable();
    }
  }

  /** @param {any} guess @param {boolean} first */
  _card(guess, first) {
    const image = h("img", { alt: "", width: 96, height: 96 });
    this._picture(guess, image);
    const radio = h("input", { type: "radio", name: "sketch-guess", class: "visually-hidden", ".checked": first, on: { change: () => this._choose(guess) } });
    return h("label", { class: "sketch-guess" }, radio, image, h("span", null, `${titled(guess.noun)} ${Math.round(guess.probability * 100)} %`));
  }

  /** Without WebGL the words remain. @param {any} guess @param {HTMLImageElement} image */
  async _picture(guess, image) {
    try {
      const { snapshotAssets } = await import("../../../viewer/snapshot.js");
      const [blob] = await snapshotAssets([{ buffer: bytesOf(guess.mesh).buffer }], { width: 192, height: 192 });
      if (!this.scope.over) image.src = this.scope.url(blob);
    } catch (error) {
      console.warn(error);
      image.hidden = true;
    }
  }

  /** @param {any} guess */
  _choose(guess) {
    this._turn();
    const values = Object.fromEntries(guess.parameters.map((/** @type {any} */ each) => [each.name, each.value]));
    fill(this.fields, guess.parameters.map((/** @type {any} */ each) => this._field(each, (value) => {
      values[each.name] = value;
      this._make(guess.noun, values);
    })));
    this._show(meshFile(bytesOf(guess.mesh), guess.noun), false);
  }

  /** @param {any} about @param {(value: number | string) => void} set */
  _field(about, set) {
    const label = titled(about.name);
    if (about.options) {
      const options = about.options.map((/** @type {string} */ value) => h("option", { value }, titled(value)));
      const choice = h("select", { "aria-label": label, on: { change: () => set(choice.value) } }, options);
      choice.value = about.value;
      return h("label", null, h("span", { class: "small muted" }, label), choice);
    }
    const slider = h("input", { type: "range", "aria-label": label, min: about.minimum, max: about.maximum, step: "any", on: { input: () => set(Number(Number(slider.value).toFixed(4))) } });
    slider.value = about.value;
    return h("label", null, h("span", { class: "small muted" }, label), slider);
  }

  /** Make the mesh of other sliders, a moment after the last change. @param {string} noun @param {Record<string, any>} values */
  async _make(noun, values) {
    const signal = this._turn();
    this.mesh = null;
    this._enable();
    if (!(await this.scope.sleep(PAUSE_MS)) || signal.aborted) return;
    try {
      const bytes = await client.makeSketchMesh({ noun, values: { ...values } }, signal);
      if (signal.aborted) return;
      fill(this.problem);
      this._show(meshFile(bytes, noun), true);
    } catch (error) {
      if (!isAbort(error) && !signal.aborted) fill(this.problem, problemBox(error));
    }
  }

  /** @param {File} mesh @param {boolean} keepCamera */
  async _show(mesh, keepCamera) {
    this.mesh = mesh;
    this._enable();
    this.view.hidden = false;
    if (!this.box) {
      this.box = new ViewerBox("Drawn shape", this.scope);
      this.view.append(this.box.element);
    }
    await this.box.load(await mesh.arrayBuffer(), "glb", keepCamera);
  }

  /** @param {"target" | "asset"} as */
  _use(as) {
    if (!this.mesh) return;
    this.use(this.mesh, as);
    this.element.close();
  }
}

/** Open the dialog. @param {(mesh: File, as: "target" | "asset") => void} use Given the mesh, and what it is to be. @param {import("../../scope.js").Scope} scope */
export function askForSketch(use, scope) {
  const dialog = new SketchDialog(use);
  scope.add(() => dialog.scope.dispose());
}
