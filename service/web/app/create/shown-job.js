// @ts-check
/** The job that the workbench shows: its shapes, those of its other versions, and the step from which another job starts. */
import { client, isAbort } from "../client.js";
import { chip } from "../dom.js";
import { count } from "../format.js";
import { isTerminal } from "../history.js";
import { isDeformation, shapesOf } from "../job/shapes.js";
import { resultShape, versionShapes } from "../job/versions.js";

/** @typedef {import("./live.js").Shape} Shape */

export class ShownJob {
  /** @param {import("./view.js").Workbench} bench */
  constructor(bench) {
    this.bench = bench;
    /** What the form asks for where it asks for the job, as `shapeKey` has it; empty: it is not known yet, or there is none. */
    this.key = "";
    /** And the strength that it had, and all of it. */
    this.strength = 1;
    this.wish = /** @type {any} */ (null);
    /** Shapes that the job has, and those of other versions. */
    this.offered = { steps: /** @type {number[]} */ ([]), finished: false, lastStep: 0 };
    /** @type {Shape[]} */
    this.versions = [];
    /** The step of the job from which another one starts. @type {number | null} */
    this.start = null;
    this.starts = chip("", () => this.startFrom(null));
    this.starts.hidden = true;
  }

  /** Whether the form asks for the job, and not for another one. */
  get isAsked() {
    const { panel, shared, requests } = this.bench;
    return panel !== null && this.key !== "" && (shared || (requests.key === this.key && this.start === null));
  }

  /** What the form asks for now is the job. @param {string} key */
  is(key) {
    this.key = key;
    this.strength = this.bench.settings.strength.share;
    this.wish = this.bench.requests.wish();
  }

  /** Follow it, and find its other versions. @param {any} job @param {string} against A job whose result it is compared with; empty: none. */
  attach(job, against) {
    const { panel, shared, scope } = this.bench;
    panel?.follow();
    if (shared) return;
    versionShapes(job, scope.signal).then(
      (versions) => {
        this.versions = versions;
        this.draw();
        if (against) this._compare(against, versions.find(({ href }) => href?.endsWith(against)));
      },
      (error) => isAbort(error) || console.warn(error),
    );
  }

  /** Compare with the result of a job, of this thread or not. @param {string} id @param {Shape | undefined} version */
  async _compare(id, version) {
    const { scope, comparison } = this.bench;
    if (version) return comparison.against(version);
    const job = await client.get(id, scope.signal).catch(() => null);
    if (!job || !isDeformation(job)) return;
    const other = resultShape(job, scope.signal);
    this.versions = [...this.versions, other];
    this.draw();
    comparison.against(other);
  }

  /** @param {number[]} steps Whose shape is kept. @param {boolean} finished @param {number} lastStep */
  offer(steps, finished, lastStep) {
    this.offered = { steps, finished, lastStep };
    this.draw();
  }

  /** Show the shapes that jobs have; the newest of this one is what its form asks for. */
  draw() {
    const { panel, strip, live } = this.bench;
    if (!panel || !this.key) return strip.offer(this.versions);
    const { steps, finished, lastStep } = this.offered;
    const found = shapesOf(panel.job, steps, finished ? lastStep : null);
    const shapes = found.map((each, i) => this._shape(each, i === found.length - 1));
    strip.offer([...this.versions, ...shapes]);
    const newest = shapes.at(-1);
    if (newest) live.know(newest);
    this.bench.offerKeep();
  }

  /** @param {import("../job/shapes.js").Shape} shape @param {boolean} newest @returns {Shape} */
  _shape({ path, label, name, step }, newest) {
    const { strip, scope } = this.bench;
    return {
      key: newest ? this.key : path,
      label,
      load: () => client.bytes(path, { signal: scope.signal }),
      strength: name === "" ? this.strength : 1,
      tag: label,
      picture: strip.stored.find(({ stored }) => stored?.path === path)?.picture,
      wish: newest ? this.wish : null,
      stored: { path, name, step: name.startsWith("step") ? step : null },
    };
  }

  /** Let the next job start from a step of this one. @param {number | null} step Null: from the asset. */
  startFrom(step) {
    const { panel } = this.bench;
    const from = panel && isTerminal(panel.job.state) ? step : null;
    this.start = from;
    this.starts.hidden = from === null;
    this.starts.textContent = from === null ? "" : `Starts from step ${count(from)} ✕`;
    this.starts.setAttribute("aria-label", `Starts from step ${from}: start from the asset instead`);
    this.bench.offerKeep();
  }

  /** @param {any[]} artifacts Files of the job, which is over. */
  async finished(artifacts) {
    const { panel, downloads, assets, scope } = this.bench;
    const { job, state } = /** @type {import("../job/panel.js").JobPanel} */ (panel);
    if (state === "succeeded") downloads.names = artifacts.map(({ name }) => name);
    this.bench.suitLive();
    this.bench.offerKeep();
    if (!assets.flat || !artifacts.some(({ name }) => name === "preview.png")) return;
    assets.showPicture(await client.download(job, "preview.png", { signal: scope.signal }));
  }
}
