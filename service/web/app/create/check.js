// @ts-check
/** What the server says of what the form asks for, before it is sent: how long it takes, whether it can be, what is wrong. */
import { client, errorsOf, isAbort, MeshdeformError } from "../client.js";
import { fill, h } from "../dom.js";
import { estimateWords, percent } from "../format.js";
import { currentKey } from "../key.js";
import { showOutlook } from "../outlook.js";
import { problemBox } from "../problem-box.js";
import { isAboutPrompt } from "../refusal.js";
import { routeHash } from "../router.js";
import { debounced } from "../scope.js";

const PAUSE_MS = 450;
/** What is quicker needs no word. */
const QUICK_MS = 400;
const INVALID = '[aria-invalid="true"]';

export class Check {
  /** @param {import("./view.js").Workbench} bench */
  constructor(bench) {
    this.bench = bench;
    /** The steps that the server plans; null: it has not said. @type {number | null} */
    this.steps = null;
    /** What the last check could tell the outlook of, as `_goal` has it; empty: of nothing. */
    this.foreseen = "";
    /** Stops the check under way, which is out of date. */
    this.checking = new AbortController();
    bench.scope.add(() => this.checking.abort());
    /** Check once the form rests. */
    this.soon = debounced(() => this._check(), PAUSE_MS, bench.scope);
    this.outlook = h("div", { class: "outlook", "aria-live": "polite", hidden: true });
    this.problem = h("div", { class: "problem-slot" });
  }

  /** The form has changed: what was foreseen of another goal is taken away. */
  changed() {
    if (this.foreseen !== this._goal()) this._showOutlook(null);
    this.soon();
  }

  /** Check again once the asset has been read, which the outlook needs. */
  foresee() {
    if (this.bench.settings.byShape && !this.foreseen) this.soon();
  }

  /** Ask once more, in place of the check under way. @param {import("../assets.js").Asset} asset @param {import("../params.js").Wish} wish @returns {Promise<number>} the steps that the server plans */
  async again(asset, wish) {
    this.checking.abort();
    const { requests, guide } = this.bench;
    const { params } = await client.validate(...(await asset.submission(requests.document(wish), guide.files)));
    this.steps = params.steps;
    return params.steps;
  }

  async _check() {
    const { assets: { asset }, requests, prompt, guide, scope } = this.bench;
    this.checking.abort();
    const { signal } = (this.checking = new AbortController());
    const good = this._settle();
    this._block(!good);
    if (!good) {
      this.bench.form.estimate.textContent = "Correct the marked settings.";
      return;
    }
    if (!asset || requests.isAimless) {
      prompt.refuse(null);
      this.bench.form.estimate.textContent = prompt.value ? "" : "Enter a prompt, or pick one.";
      return;
    }
    const say = (/** @type {string} */ text) => signal.aborted || (this.bench.form.estimate.textContent = text);
    const slow = setTimeout(say, QUICK_MS, "Checking…");
    asset.onProgress = (share) => (clearTimeout(slow), say(share < 1 ? `Uploading, ${percent(share)}` : "Checking…"));
    try {
      const found = await client.validate(...(await asset.submission(requests.document(undefined, this.steps), guide.files, signal)));
      if (!signal.aborted && !scope.over) this._good(found);
    } catch (error) {
      if (!signal.aborted && !scope.over && !isAbort(error)) this.refused(error);
    } finally {
      clearTimeout(slow);
    }
  }

  /** @param {any} found */
  _good(found) {
    this.steps = found.params.steps;
    this._showOutlook(found.outlook ?? null);
    this.bench.prompt.refuse(null);
    fill(this.problem);
    const { triangles, vertices, meshes, joints, skipped, warnings } = found.asset;
    this.bench.suitRig(joints);
    const more = [meshes > 1 ? `${meshes} meshes` : "", skipped.length ? `${skipped.length} left as they are` : ""].filter(Boolean);
    this.bench.assets.describe(triangles, vertices, more, warnings);
    this.bench.form.estimate.textContent = estimateWords(found);
  }

  /** What an outlook depends on. */
  _goal() {
    const { assets: { asset }, settings, prompt, guide } = this.bench;
    return JSON.stringify([settings.byShape, prompt.value, guide.meshes.length, asset?.name, asset?.size]);
  }

  /** @param {import("../outlook.js").Outlook | null} outlook Null: it is not known. */
  _showOutlook(outlook) {
    const { prompt, guide } = this.bench;
    this.foreseen = outlook ? this._goal() : "";
    // A target takes the place of the prompt.
    showOutlook(this.outlook, outlook && guide.target ? { ...outlook, suggestions: [] } : outlook, (text) => prompt.take(text));
  }

  // What is wrong.

  /** Show that the job cannot start yet; the button still leads to what is wrong. @param {boolean} on */
  _block(on) {
    this.bench.form.button.classList.toggle("button-blocked", on);
  }

  /** Return whether all settings can be sent; what cannot is marked. */
  _settle() {
    const { settings, control, guide } = this.bench;
    const found = [settings.check(), control.check(settings.subdivide.checked), guide.check()];
    this._unfold();
    return found.every(Boolean);
  }

  _unfold() {
    const { more } = this.bench;
    if (more.querySelector(`${INVALID}, .field-problem:not([hidden])`)) more.open = true;
  }

  /** Return whether a job can start; what is wrong has the focus. */
  ready() {
    const { requests, prompt, more, guide, control, assets } = this.bench;
    if (requests.isAimless) {
      prompt.refuse("Enter a prompt first.");
      prompt.input.focus();
    } else if (!this._settle()) {
      const at = /** @type {HTMLElement | null} */ (more.querySelector(INVALID));
      if (at) at.focus();
      else (guide.check() ? control : guide).focusProblem();
    } else return assets.asset !== null;
    return false;
  }

  /** Say why no job started. @param {unknown} error */
  refuseJob(error) {
    const { requests, assets, prompt } = this.bench;
    if (requests.sent !== assets.asset) return; // that file has given way to another
    this.refused(error);
    if (prompt.input.hasAttribute("aria-invalid")) prompt.input.focus();
  }

  /** Say what was refused beside it. @param {unknown} error */
  refused(error) {
    this.bench.form.estimate.textContent = "";
    const found = error instanceof MeshdeformError ? error : null;
    if (found?.status === 401 && !currentKey()) this.bench.form.estimate.textContent = "This server asks for a key once you change or keep something.";
    else {
      this._block(true);
      const about = isAboutPrompt(error);
      this.bench.prompt.refuse(about ? error : null);
      fill(this.problem, about ? null : this._said(error, found));
    }
    this._unfold();
  }

  /** What is said of an error below the prompt; null where it is said beside what is wrong. @param {unknown} error @param {MeshdeformError | null} found */
  _said(error, found) {
    const { assets, guide, control } = this.bench;
    if (found?.code.startsWith("asset_")) {
      const { surface } = found.problem; // points, a grid or a network
      assets.refuse(found.message, surface ? "Fit one first, and deform the mesh that it becomes." : found.advice);
      return surface ? h("a", { class: "chip", href: routeHash({ name: "surface", from: null, quick: true }) }, "Fit a surface to it") : null;
    }
    if (found?.status === 404) for (const file of [assets.asset, ...Object.values(guide.files)]) file?.forgetUpload();
    if (found && guide.refuse(found)) return null;
    const errors = errorsOf(error);
    return errors.length && control.refuse(errors) ? null : problemBox(error);
  }
}
