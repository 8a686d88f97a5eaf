// @ts-check
/** What the form asks of the server: how the asset is read, shapes before a job runs, and the job. */
import { client, MeshdeformError } from "../client.js";
import { documentOf } from "../params.js";
import { routeHash } from "../router.js";
import { readingOf } from "./control/model.js";
import { shapeKey } from "./live.js";

/** @typedef {import("../assets.js").Asset} Asset */
/** @typedef {import("../params.js").Wish} Wish */

export class Requests {
  /** @param {import("./view.js").Workbench} bench */
  constructor(bench) {
    this.bench = bench;
    /** The asset of the job that was sent last. @type {Asset | null} */
    this.sent = null;
  }

  /** All that the form holds. */
  wish() {
    const { settings, prompt, control, guide } = this.bench;
    return { ...settings.wish(prompt.value), control: control.value(), guide: guide.value() };
  }

  /** What a shape is asked for: it has its full strength. */
  shapeWish() {
    return { ...this.wish(), strength: "" };
  }

  /** What a person said of what the asset is. */
  said() {
    return readingOf(this.bench.control.control);
  }

  /** Nothing but what the asset is, and a prompt. @param {string} prompt @returns {Wish} */
  saidWish(prompt) {
    return { ...this.bench.settings.wish(prompt), strength: "", control: this.said() };
  }

  /** What the form asks for, whatever the strength: a slider shows the shares of its way. */
  get key() {
    const { seed, control, ...others } = this.shapeWish();
    const { of: _, ...asked } = control;
    return shapeKey(JSON.stringify([this.bench.assets.asset?.print, others, asked]), seed);
  }

  /** Whether nothing says yet what the asset should become. */
  get isAimless() {
    const { shared, prompt, guide } = this.bench;
    return !shared && !prompt.value && guide.isEmpty;
  }

  /** Whether a shape can be made before a job runs. */
  get isPossible() {
    const { shared, settings, guide } = this.bench;
    return !shared && settings.byShape && guide.isEmpty && !settings.subdivide.checked;
  }

  /** @param {Wish} [wish] Default: all that the form holds. @param {number | null} [steps] As the server has said them. */
  document(wish = this.wish(), steps = null) {
    return documentOf(wish, steps, this.bench.settings.groups);
  }

  /** @param {AbortSignal} signal @returns {Promise<any>} The parts of the asset. */
  async parts(signal) {
    return client.parts(...(await this._asset.submission(this.document(this.saidWish("")), {}, signal)));
  }

  /**
   * @param {Wish} wish
   * @param {"glb" | "positions"} form
   * @param {number} seed
   * @param {AbortSignal} signal
   * @param {boolean} [draft] Whether a draft will do.
   * @returns {Promise<{data: ArrayBuffer, draft?: boolean}>}
   */
  async preview(wish, form, seed, signal, draft = false) {
    const options = /** @type {any} */ ({ as: form, draft, signal });
    const asset = this._asset;
    const document = { ...this.document(wish), seeds: [seed] };
    if (asset.kept) {
      try {
        return await client.preview({ sha256: asset.kept, filename: asset.name }, document, options);
      } catch (error) {
        if (!(error instanceof MeshdeformError && error.code === "asset_not_kept")) throw error;
      }
    }
    const [sent, , more] = await asset.submission(document, {}, signal);
    const made = await client.preview(sent, document, { ...more, ...options });
    asset.kept = made.asset;
    return made;
  }

  /** The shape as a job would make it, at the strength of the form. @param {AbortSignal} signal @returns {Promise<ArrayBuffer>} */
  async exact(signal) {
    const { shape, asked } = this.bench.live;
    if (shape && asked.strength === shape.strength) return shape.load();
    return (await this.preview(this.wish(), "glb", asked.seed, signal)).data;
  }

  /** Make a job of what the form asks for, and return its address. */
  async send() {
    const { check, shown, guide, beginning, panel } = this.bench;
    const asset = (this.sent = this._asset);
    const wish = this.wish();
    const { files } = guide;
    // A preset chosen a moment ago has other steps than the last check knew.
    const steps = await check.again(asset, wish);
    const document = this.document(wish, steps);
    const thread = beginning.threadOf(asset);
    if (thread) document.metadata = { thread };
    const job = shown.start !== null && panel ? await client.branch(panel.job, shown.start, /** @type {any} */ (document)) : await client.submit(...(await asset.submission(document, files)));
    return routeHash({ name: "job", id: job.id });
  }

  get _asset() {
    return /** @type {Asset} */ (this.bench.assets.asset);
  }
}
