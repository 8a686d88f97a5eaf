// @ts-check
/**
 * The result of a surface fit: the surface unfolds here from a few kilobytes. While the job runs, the newest of its shapes
 * is shown.
 */
import { announce, toast } from "../announce.js";
import { client, isAbort, isOffline } from "../client.js";
import { button, fill, h } from "../dom.js";
import { bytes, count, counted } from "../format.js";
import { stemOf } from "../names.js";
import { orToast } from "../problem-box.js";
import { ViewerBox } from "../viewer-box.js";
import { meshButtons, saveBytes } from "./files.js";
import { PictureStage } from "./picture-stage.js";
import { drawnPicture, slider, toggle } from "../widgets.js";

const AGAIN_MS = 3000;
const FIRST_FACES = 40_000; // levels come by themselves up to about as many

export class FieldStage extends PictureStage {
  /** @param {any} job @param {import("../scope.js").Scope} scope @param {File} [own] A `.ndf` in place of a job's. */
  constructor(job, scope, own) {
    super(job, scope);
    this.own = own;
    this.stem = own ? own.name.replace(/\.[^.]*$/, "") : stemOf(job);
    this.flat = false; // nothing can be drawn here
    this.box = new ViewerBox("Surface", scope);
    this.levels = slider("field-level", "Level", 0, () => this._level(Number(this.levels.input.value)));
    this.levels.row.hidden = true;
    this.facts = h("p", { class: "small muted field-facts", role: "status" });
    this.wires = toggle("Wireframe", (on) => this.box.viewer?.setWireframe(on));
    const reset = button("Reset view", () => this.box.resetView(), { icon: "reset", quiet: true, class: "button-quiet" });
    this.tools = h("div", { class: "row stage-tools", hidden: true }, this.wires, reset);
    const [save, ...handOn] = meshButtons("Download this level", () => this._mesh());
    const picture = button("Save picture", () => this._picture(), { icon: "camera", class: "button-quiet" });
    this.keep = h("div", { class: "row stage-keep", hidden: true }, save, picture, handOn);
    this.element = h(
      "section",
      { class: "job-stage field-stage", "aria-label": "Surface" },
      h("div", { class: "stage pair-stage" }, this.box.element),
      this.tools,
      this.levels.row,
      this.facts,
      this.keep,
    );
    /** @type {any} */
    this.worker = null;
    /** @type {import("../../viewer/field-worker.js").Opened | null} */
    this.opened = null;
    /** @type {import("../../viewer/field-worker.js").Level | null} The level that is shown. */
    this.shown = null;
    /** Path of the newest shape of a running job. */
    this.path = "";
    this.opening = false;
    this.wanted = 0;
    this.busy = false;
    this.box.say(job.state === "succeeded" ? "Loading the surface…" : "No shape yet");
    this.ready = job.state === "succeeded" ? this._open() : this.box.ready.then(() => void (this.box.failed && this._isFlat()));
    scope.add(() => this.worker?.dispose());
  }

  /** @param {number[]} checkpoints Steps whose mesh is kept. @param {boolean} finished */
  async offer(checkpoints, finished) {
    if (finished) {
      if (!this.opened && !this.opening) this.ready = this._open();
      return;
    }
    const step = checkpoints.at(-1);
    if (step === undefined) return;
    const path = `v1/jobs/${this.job.id}/checkpoints/${step}/mesh.glb`;
    if (path === this.path || this.opening) return;
    this.path = path;
    try {
      const mesh = await client.bytes(path, { signal: this.scope.signal });
      if (path !== this.path || this.opening) return;
      if (!(await this.box.load(mesh, "glb", true)) && !this.scope.over && path === this.path) this._isFlat();
      fill(this.box.tag, `Surface · step ${count(step)}`);
    } catch (error) {
      // It has given way to a newer one, which will do.
      if (!isAbort(error)) console.warn(error);
    }
  }

  /** Show the picture that the job made, where nothing can be drawn. @param {Blob} picture */
  showPicture(picture) {
    this.element.querySelector(".stage")?.append(drawnPicture(this.scope, picture, "The input, above, and the field, below, from four sides"));
  }

  async _open() {
    this.opening = true;
    await this.box.ready;
    if (this.box.failed) this._isFlat();
    if (this.flat || this.scope.over) return;
    this.box.say("Loading the surface…");
    try {
      const [data, { FieldWorker }] = await Promise.all([
        this.own?.arrayBuffer() ?? client.bytes(`v1/jobs/${this.job.id}/artifacts/surface.ndf`, { signal: this.scope.signal }),
        import("../../viewer/field.js"),
      ]);
      if (this.scope.over) return;
      this.worker = new FieldWorker();
      const opened = (this.opened = await this.worker.ask("open", { bytes: data }, [data]));
      this.levels.input.max = String(opened.levels);
      this.levels.row.hidden = this.tools.hidden = false;
      // The base at once, then level by level, unless someone chooses one meanwhile.
      let level = 0;
      do {
        this.wanted = level;
        await this._next();
        level++;
      } while (!this.scope.over && !this.flat && this.wanted === level - 1 && level <= opened.levels && opened.faces * 4 ** level <= FIRST_FACES);
      announce("The surface is unfolded");
    } catch (error) {
      if (this.scope.over || isAbort(error)) return;
      this.box.say("The surface cannot be shown", error instanceof Error ? error.message : "", "warn", true);
      if (isOffline(error) && (await this.scope.sleep(AGAIN_MS))) await this._open();
    }
  }

  _isFlat() {
    this.flat = true;
    this.element.classList.add("flat");
  }

  /** @param {number} level */
  _level(level) {
    this.wanted = level;
    void this._next();
  }

  /** Work until what is shown is what is wanted. While one thing is computed others may be asked for: only the newest counts. */
  async _next() {
    if (this.busy || !this.opened) return;
    this.busy = true;
    try {
      while (!this.scope.over && this.shown?.level !== this.wanted) await this._unfold(this.wanted);
    } catch (error) {
      this.wanted = this.shown?.level ?? this.wanted; // or it would be asked for again and again
      if (!this.scope.over && !isAbort(error)) toast(`Not computed. ${error instanceof Error ? error.message : ""}`);
    } finally {
      this.busy = false;
    }
  }

  /** @param {number} level */
  async _unfold(level) {
    const found = /** @type {import("../../viewer/field-worker.js").Level} */ (await this.worker.ask("level", { level }));
    const drawn = await this.box.load(found.glb.slice(0), "glb", true);
    if (this.scope.over) return;
    if (!drawn) this._isFlat();
    this.shown = found;
    this.keep.hidden = false; // before, there is nothing to keep
    this._tell();
  }

  /** Say what came over the wire, what was made of it, and how long that took. */
  _tell() {
    const { opened, shown } = this;
    if (!opened || !shown) return;
    this.levels.input.value = String(this.wanted);
    this.levels.value.textContent = String(shown.level);
    this.levels.input.setAttribute("aria-valuetext", `Level ${shown.level}, ${counted(shown.faces, "triangle")}`);
    fill(this.box.tag, `Level ${shown.level} · ${counted(shown.faces, "triangle")}`);
    const ms = milliseconds;
    this.facts.textContent = `${bytes(opened.bytes)} loaded and read in ${ms(opened.readMs)}; this level unfolded in ${ms(shown.ms)}. As a GLB it has ${bytes(shown.glb.byteLength)}.`;
  }

  /** The level that is shown. */
  _mesh() {
    return this.shown && { bytes: this.shown.glb, name: `${this.stem}-level${this.shown.level}.glb` };
  }

  _picture() {
    return orToast("No picture", async () => saveBytes(await this.box.picture(), `${this.stem}-level${this.shown?.level ?? 0}.png`));
  }
}

/** @param {number} value */
function milliseconds(value) {
  return `${value < 10 ? value.toFixed(1) : Math.round(value)} ms`;
}
