// @ts-check
/** The form for a surface fit: any surface becomes a file of a few kilobytes. Its parameters are those that the server declares. */
import { client, errorsOf, isAbort, MeshdeformError } from "../client.js";
import { fill, h } from "../dom.js";
import { lastDraft } from "../drafts.js";
import { estimateWords } from "../format.js";
import { recentJobs } from "../jobs/card.js";
import { checkpointEvery } from "../params.js";
import { problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";
import { debounced } from "../scope.js";
import { AssetPanel } from "./asset-panel.js";
import { intro, JobForm, showForm } from "./form.js";
import { NumberRows } from "./field-rows.js";
import { originOf } from "./origins.js";

const KIND = "surface_fit";
/** What most fits need; the others stand under Advanced. */
const FIRST = ["base_faces", "steps", "level", "seed"];
/** Enough for a mesh to deform: a quarter of the time of the defaults, off by 0.06 % of the diagonal on average in place of 0.03 %. */
const QUICK = { base_faces: 500, steps: 300 };
const CHECKPOINTS = "checkpoint_every_steps"; // ten on the way, if nobody says otherwise

export class SurfaceView {
  /**
   * @param {HTMLElement} root
   * @param {import("../scope.js").Scope} scope
   * @param {string | null} from A job to begin with.
   * @param {boolean} [quick] Whether the surface is to become an asset: the numbers are then those of a quick fit.
   */
  constructor(root, scope, from, quick = false) {
    this.scope = scope;
    this.turn = 0; // of the last check: an answer to an earlier one is out of date
    /** What a job that is run again has and the form has no field for. */
    this.kept = nothingKept();
    this.check = debounced(() => this._check(), 450, scope);
    this.assets = new AssetPanel(scope, () => {
      this.kept = nothingKept();
      this.check();
    });
    this.numbers = new NumberRows(KIND, FIRST, () => this.check());
    this.problem = h("div", { class: "problem-slot" });
    this.form = new JobForm(scope, "New surface fit", "Fit", { ready: () => this._ready(), send: () => this._send(), refuse: (error) => this._bad(error) });
    const hint = "A quick fit, which is enough for a mesh to deform. With both numbers empty, the fit takes four times as long and is twice as precise.";
    this.form.element.append(
      ...(quick ? [h("p", { class: "small muted" }, hint)] : []),
      this.numbers.first,
      this.problem,
      this.numbers.advanced,
      h("p", { class: "small" }, h("a", { href: routeHash({ name: "field" }) }, "Open a .ndf"), " that you have."),
      this.form.bar(),
    );
    showForm(root, "surface", intro("Any surface in", "a few kilobytes", "A coarse mesh and a small network, which a browser unfolds to any level."), this.assets, this.form, recentJobs(scope));
    this._begin(from, quick);
  }

  /** @param {string | null} from @param {boolean} quick */
  async _begin(from, quick) {
    const asset = from ? this._again(from) : this._firstAsset();
    try {
      await this.numbers.load(this.scope.signal);
    } catch (error) {
      if (!this.scope.over && !isAbort(error)) fill(this.problem, problemBox(error));
    }
    if (this.scope.over) return;
    this.numbers.fill((await asset) ?? (quick ? QUICK : {}));
    this.check();
  }

  /** The file in the other form, if there is one. @returns {Promise<null>} */
  async _firstAsset() {
    const draft = await lastDraft();
    if (this.scope.over || this.assets.choices) return null;
    await (draft?.asset ? this.assets.use(draft.asset) : this.assets.example());
    return null;
  }

  /** @param {string} id @returns {Promise<Record<string, any> | null>} The parameters of a job whose file is used again. */
  async _again(id) {
    try {
      const { job, asset, others } = await originOf(id, this.scope.signal);
      if (!this.assets.choices) await this.assets.use(asset);
      if (job.kind !== KIND) return null;
      const { anchors } = job.params;
      this.kept = { params: anchors ? { anchors } : {}, files: others };
      return job.params;
    } catch (error) {
      if (!isAbort(error)) fill(this.problem, problemBox(error));
      return null;
    }
  }

  _document() {
    /** @type {Record<string, any>} */
    const params = { ...this.kept.params, ...this.numbers.values() };
    const steps = params.steps ?? this.numbers.standard("steps");
    if (steps) params[CHECKPOINTS] ??= checkpointEvery(steps);
    return { kind: KIND, params };
  }

  async _check() {
    const turn = ++this.turn;
    const { asset } = this.assets;
    const good = this.numbers.settle();
    this.form.button.classList.toggle("button-blocked", !good);
    this.form.estimate.textContent = good ? "" : "Correct the marked settings.";
    if (!asset || !good) return;
    try {
      const found = await client.validate(...(await asset.submission(this._document(), this.kept.files, this.scope.signal)));
      if (turn !== this.turn || this.scope.over) return;
      fill(this.problem);
      this.assets.refuse("");
      const { triangles, vertices, warnings } = found.asset;
      this.assets.describe(triangles, vertices, [], warnings);
      this.form.estimate.textContent = estimateWords(found);
    } catch (error) {
      if (turn === this.turn && !this.scope.over && !isAbort(error)) this._bad(error);
    }
  }

  /** @param {unknown} error */
  _bad(error) {
    this.form.button.classList.add("button-blocked");
    this.form.estimate.textContent = "";
    const found = error instanceof MeshdeformError ? error : null;
    if (found?.code.startsWith("asset_")) {
      this.assets.refuse(found.message, found.advice);
      return void fill(this.problem);
    }
    if (found?.status === 404) for (const file of [this.assets.asset, ...Object.values(this.kept.files)]) file?.forgetUpload();
    fill(this.problem, this.numbers.refuse(errorsOf(error)) ? null : problemBox(error));
  }

  _ready() {
    const settled = this.numbers.settle();
    if (!settled) this.form.focusProblem();
    return settled && this.assets.asset !== null;
  }

  async _send() {
    this.turn += 1;
    const asset = /** @type {import("../assets.js").Asset} */ (this.assets.asset);
    const job = await client.submit(...(await asset.submission(this._document(), this.kept.files)));
    return routeHash({ name: "job", id: job.id });
  }
}

/** @returns {{params: Record<string, any>, files: Record<string, import("../assets.js").Asset>}} */
function nothingKept() {
  return { params: {}, files: {} };
}
