// @ts-check
/** The result of a job about a family: its wall; and where shapes were made, one of them as its file describes it. */
import { client } from "../client.js";
import { fill, h } from "../dom.js";
import { percent } from "../format.js";
import { currentLink } from "../key.js";
import { stemOf } from "../names.js";
import { shapeWords } from "../quality.js";
import { ViewerBox } from "../viewer-box.js";
import { meshButtons } from "./files.js";
import { PictureStage } from "./picture-stage.js";
import { slider } from "../widgets.js";
import { SynthesisPanel } from "./synthesis-panel.js";
import { WallView } from "./wall-view.js";

export class FamilyStage extends PictureStage {
  /** @param {any} job @param {import("../scope.js").Scope} scope */
  constructor(job, scope) {
    super(job, scope);
    this.flat = false; // nothing can be drawn here
    /** Called with the name of a shape that was clicked. @type {(name: string) => void} */
    this.onChoose = () => {};
    /** @type {Map<string, Uint8Array<ArrayBuffer>>} */
    this.files = new Map();
    /** @type {string[] | null} */
    this.framed = null;
    this.makes = job.kind === "family_synthesize" && job.params.mode !== "search";
    this.wall = new WallView(scope, (shape) => this._chosen(shape));
    if (job.state === "succeeded") this.wall.box.say("Loading the wall…");
    else this.wall.box.say("No wall yet", "It comes with the result.", "info");
    this.shape = this.makes ? new ViewerBox("Shape", scope) : null;
    this.pick = slider("family-shape", "Shape", 0, () => this._show(Number(this.pick.input.value)));
    this.pick.row.hidden = true;
    this.save = h("div", { class: "row", hidden: true }, meshButtons("Download this shape", () => this._mesh()));
    this.frame = h("div", { class: "stage pair-stage" }, this.wall.box.element, this.shape?.element);
    this.element = h("section", { class: "job-stage", "aria-label": "Result" }, this.frame, this.pick.row, this.save, this.wall.tools);
    this.ready = this.wall.box.ready.then(() => void (this.flat = this.wall.box.failed));
  }

  /** Show what the job made. @param {any} report @param {string[]} names Of the artifacts. @param {HTMLElement} results What stands beside it. */
  async finished(report, names, results) {
    this.report = report;
    // Who came by a link makes no jobs.
    if (this.job.kind === "family_fit" && !currentLink() && names.includes("family.safetensors")) {
      const panel = new SynthesisPanel(this.job, report, names, this.scope, (members) => this.choose(members));
      this.onChoose = (name) => panel.take(name);
      results.prepend(panel.element);
    }
    const read = (/** @type {string} */ name) => client.bytes(`v1/jobs/${this.job.id}/artifacts/${name}`, { signal: this.scope.signal });
    await this.ready;
    if (this.flat) return;
    const [wall, shapes] = await Promise.all([read("wall.glb"), this.makes ? read("shapes.zip") : null]);
    if (this.scope.over) return;
    await this.wall.show(wall);
    if (this.framed) this.choose(this.framed);
    if (!shapes || !this.shape) return;
    this.files = (await import("../../viewer/zip.js")).filesOf(shapes);
    this.pick.input.max = String(this.files.size - 1);
    this.pick.row.hidden = this.files.size < 2;
    this.save.hidden = false;
    await this._show(0);
  }

  /** Frame shapes on the wall. @param {string[]} names */
  choose(names) {
    this.framed = names;
    this.wall.choose(names.map((name) => this.wall.names.indexOf(name)).filter((shape) => shape >= 0));
  }

  /** @param {number} shape */
  _chosen(shape) {
    if (this.makes) void this._show(shape);
    else this.onChoose(this.wall.names[shape]);
  }

  /** @param {number} number */
  async _show(number) {
    const [name, bytes] = [...this.files][number];
    this.name = name;
    this.pick.input.value = String(number);
    const label = this._label(number);
    this.pick.value.textContent = `${number + 1} of ${this.files.size}`;
    this.pick.input.setAttribute("aria-valuetext", label);
    this.wall.choose([number]);
    if (!this.shape) return;
    fill(this.shape.tag, `${name} · ${label}`);
    await this.shape.load(bytes.slice().buffer, "glb", true);
  }

  /** What a shape is: how far it is from one member to the other, or which one it is most like. @param {number} number */
  _label(number) {
    const { mode, members } = this.job.params;
    if (mode === "interpolate") return `${percent(number / (this.files.size - 1))} from ${members[0]} to ${members[1]}`;
    return shapeWords(this.report.shapes[number]);
  }

  /** The shape that is shown. */
  _mesh() {
    const bytes = this.files.get(this.name ?? "");
    return bytes ? { bytes: bytes.buffer, name: `${stemOf(this.job)}-${this.name}` } : null;
  }
}
