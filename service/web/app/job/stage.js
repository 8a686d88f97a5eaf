// @ts-check
/** Before and after of a job in 3D: the shapes on the way, morphing, heat maps, wireframe, and files of what is shown. */
import { client, isAbort, isOffline, MeshdeformError } from "../client.js";
import { formatOf } from "../assets.js";
import { button, fill, h } from "../dom.js";
import { percent } from "../format.js";
import { isTerminal } from "../history.js";
import { currentLink } from "../key.js";
import { shapeName } from "../names.js";
import { COLOURS, PairStage } from "../pair-stage.js";
import { orToast } from "../problem-box.js";
import { saveBytes } from "./files.js";
import { shapesOf } from "./shapes.js";
import { slider } from "./stage-controls.js";

/** @typedef {import("./shapes.js").Shape} Shape */

// Percent: a shape that most of what went wrong has not reached.
const WEAKER = "60";
const AGAIN_MS = 3000;
const BUSY = [429, 502, 503, 504];

export class JobStage extends PairStage {
  /** @param {any} job @param {import("../scope.js").Scope} scope */
  constructor(job, scope) {
    super(scope, { label: "Before and after", tags: ["Before", "After"], colours: COLOURS });
    this.job = job;
    this.before = this.views[0];
    this.after = this.views[1];
    /** @type {Shape[]} */
    this.shapes = [];
    this.following = true; // the newest shape is shown as it comes
    this.chosen = -1;
    /** Path of the shape that is shown; empty: the source. */
    this.shown = "";
    /** And its strength, as it was asked for. */
    this.shownStrength = "";
    /** @type {Set<string>} Shapes that the server no longer has. */
    this.gone = new Set();
    this.busy = false;
    this.loaded = false;
    this.step = slider("scrubber", "Step", 0, () => this._scrub());
    this.morph = slider("morph-slider", "Morph", 100, () => this._morph());
    this.morph.input.value = "100";
    this.morph.input.addEventListener("change", () => this._strengthen());
    /** Whether the server makes strengths of the result, which it does not for a link. */
    this.able = !currentLink();
    /** Where the slider has stopped, this asks for the shape there; empty: straight lines lead to the shape. */
    this.strength = "";
    this.colours.hidden = false;
    this.save = button("Download this shape", () => this._download(), { icon: "download" });
    this.picture = button("Save picture", () => this._picture(), { icon: "camera", class: "button-quiet" });
    this.keep = h("div", { class: "row stage-keep", hidden: true }, this.save, this.picture);
    this.element.append(this.step.row, this.morph.row, this.keep);
    // Until its own shape is there, the source must not pass for it.
    if (job.state === "succeeded" || job.origin?.step) this.after.say("Loading the shape…", "", "", true);
    this._tag();
    this.ready = this._load();
  }

  async _load() {
    try {
      const source = await client.bytes(`v1/jobs/${this.job.id}/asset`, { signal: this.scope.signal });
      const format = formatOf(this.job.asset.filename) || "glb"; // a file without a known ending is a GLB
      // Each viewer has a copy: what it reads it may keep.
      const [found] = await Promise.all(this.views.map((view) => view.load(source.slice(0), format)));
      this.flat = found === null;
      this.element.classList.toggle("flat", this.flat);
      this.loaded = true;
      this._next();
    } catch (error) {
      if (this.scope.over || isAbort(error)) return;
      this.before.say("The asset could not be loaded", error instanceof Error ? error.message : "", "warn", true);
      if (isOffline(error) && (await this.scope.sleep(AGAIN_MS))) await this._load();
    }
  }

  /**
   * Say which shapes there are; the newest is shown, unless the user looks at another.
   * @param {number[]} checkpoints Steps whose mesh is kept.
   * @param {boolean} finished Whether there is a result.
   * @param {number} lastStep
   */
  offer(checkpoints, finished, lastStep) {
    const looked = this.shapes[this.chosen];
    this.shapes = shapesOf(this.job, checkpoints, finished ? lastStep : null).filter(({ path }) => !this.gone.has(path));
    this.step.input.max = String(this.shapes.length);
    this.step.row.hidden = this.shapes.length < 1;
    if (this.following || !looked) this.chosen = this.shapes.length - 1;
    else this.chosen = Math.max(0, this.shapes.findIndex((shape) => shape.step >= looked.step));
    this._position();
    this._tag();
    this._next();
  }

  /** The step that the slider is at; null at the source and at the result. */
  get chosenStep() {
    const shape = this.shapes[this.chosen];
    return shape?.name.startsWith("step") ? shape.step : null;
  }

  _position() {
    this.step.input.value = String(this.chosen + 1);
    const label = this.shapes[this.chosen]?.label ?? "Source";
    this.step.value.textContent = label;
    this.step.input.setAttribute("aria-valuetext", label);
  }

  /** Name what the second view shows. */
  _tag() {
    const shape = this.shapes.find(({ path }) => path === this.shown);
    const share = this._share();
    const none = this.shapes.length || isTerminal(this.job.state) ? "Source" : "Source, no new shape yet";
    const parts = shape ? ["After", shape.label === "Result" ? "" : shape.label.toLowerCase(), share === 100 ? "" : `${this._mayStrengthen() ? "strength" : "morph"} ${share}%`] : [none];
    fill(this.after.tag, parts.filter(Boolean).join(" · "));
    this.keep.hidden = !shape || this.flat;
    // The server makes strengths of results alone.
    this.save.disabled = this.comparable && share !== 100 && !this._mayStrengthen();
    this.save.title = this.save.disabled ? "Set Morph to 100% first" : "";
  }

  _scrub() {
    this.chosen = Number(this.step.input.value) - 1;
    this.following = this.chosen === this.shapes.length - 1;
    this._position();
    this._next();
  }

  /** Show what is chosen. While one shape is loaded others may come: then only the newest of them is loaded. */
  async _next() {
    if (this.busy || !this.loaded || this.flat) return;
    this.busy = true;
    try {
      while (!this.scope.over && this._differs()) {
        const shape = this.shapes[this.chosen];
        if (shape) await this._show(shape);
        else this._showSource();
      }
    } finally {
      this.busy = false;
    }
  }

  _differs() {
    const shape = this.shapes[this.chosen];
    return this.shown !== (shape?.path ?? "") || this.shownStrength !== this._strengthOf(shape);
  }

  /** What is asked of a shape's strength: only results have one. @param {Shape | undefined} shape */
  _strengthOf(shape) {
    return shape?.name === "" ? this.strength : "";
  }

  _showSource() {
    this.after.say("");
    this.after.viewer?.setMorph(0);
    this.shown = this.shownStrength = "";
    this._tag();
  }

  /** @param {Shape} shape */
  async _show(shape) {
    try {
      const strength = this._strengthOf(shape);
      const mesh = await client.bytes(shape.path + strength, { signal: this.scope.signal });
      if (this.scope.over || strength !== this._strengthOf(shape)) return; // the slider moved on
      this.comparable = await this.after.deform(mesh);
      if (this.scope.over) return;
      this.after.say("");
      this.shown = shape.path;
      this.shownStrength = strength;
      this.morph.input.max = this._mayStrengthen() ? "150" : "100";
      this.morph.row.hidden = !this.comparable;
      this.colours.hidden = !this.comparable;
      this._place();
      this.colour(this.kind);
    } catch (error) {
      if (!isAbort(error)) await this._missing(shape, error);
    }
  }

  /** @param {Shape} shape @param {unknown} error */
  async _missing(shape, error) {
    if (this.strength && error instanceof MeshdeformError && !error.unanswered && !BUSY.includes(error.status)) {
      console.info("The way is straight:", error);
      this.able = false;
      this.strength = "";
      this.morph.input.max = "100";
      return this._place();
    }
    // A checkpoint gives way to newer ones: the next one will do.
    if (error instanceof MeshdeformError && error.status === 404) {
      this.gone.add(shape.path);
      const at = this.shapes.indexOf(shape);
      if (at >= 0) this.shapes.splice(at, 1);
      this.step.input.max = String(this.shapes.length);
      this.chosen = Math.min(this.chosen, this.shapes.length - 1);
      this._position();
      if (this.chosen < 0 && !this.shown) this._showSource();
      return;
    }
    console.warn(error);
    if (!this.shown) this.after.say("This shape could not be loaded", "Trying again…", "warn", true);
    await this.scope.sleep(AGAIN_MS);
  }

  /** Percent of the way from the source to the shape. */
  _share() {
    return Number(this.morph.input.value);
  }

  /** Whether the server makes other strengths of what is shown. */
  _mayStrengthen() {
    const shape = this.shapes.find(({ path }) => path === this.shown);
    return this.able && this.comparable && shape?.name === "";
  }

  /** The slider moves: vertices go on straight lines until it stops. */
  _morph() {
    this.strength = "";
    this._place();
    this._next();
  }

  /** Show the result at less strength. */
  weaken() {
    this.morph.input.value = WEAKER;
    this._morph();
    this._strengthen();
    this.morph.input.focus();
  }

  /** The slider has stopped: the shape of this strength is the server's. */
  _strengthen() {
    const share = this._share();
    this.strength = share === 100 || !this._mayStrengthen() ? "" : `?strength=${share / 100}`;
    this._next();
  }

  _place() {
    const share = this._share();
    this.morph.value.textContent = percent(share / 100);
    this.morph.input.setAttribute("aria-valuetext", `${share} percent`);
    if (this.shown) this.after.viewer?.setMorph(this.shownStrength ? 1 : share / 100);
    this._tag();
  }

  /** Save the shape that is on the screen. */
  async _download() {
    const shape = this.shapes.find(({ path }) => path === this.shown);
    if (!shape) return;
    const share = this.comparable ? this._share() : 100;
    await orToast("Not downloaded", async () => {
      const bytes = await client.bytes(shape.path + (share === 100 ? "" : `?strength=${share / 100}`), { signal: this.scope.signal });
      saveBytes(new Blob([bytes], { type: "model/gltf-binary" }), shapeName(this.job, shape.name, share));
    });
  }

  /** Save a picture of the second view. */
  _picture() {
    const shape = this.shapes.find(({ path }) => path === this.shown);
    return orToast("No picture", async () => saveBytes(await this.after.picture(), shapeName(this.job, shape?.name ?? "", this._share(), "png")));
  }

  /** @param {string} ending */
  turntableName(ending) {
    const shape = this.shapes.find(({ path }) => path === this.shown);
    return shapeName(this.job, ["turntable", shape?.name].filter(Boolean).join("-"), this._share(), ending);
  }
}
