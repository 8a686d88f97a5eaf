// @ts-check
/** What the form begins with: a draft, a job, one of the examples, or our sample. */
import { Asset, exampleAsset } from "../assets.js";
import { client, isAbort } from "../client.js";
import { DEMO } from "../demo.js";
import { chip, fill, h } from "../dom.js";
import { forgetDrafts, lastDraft } from "../drafts.js";
import { threadOf } from "../job/versions.js";
import { fileKey, wishOf } from "../params.js";
import { learnNames } from "../plain.js";
import { problemBox } from "../problem-box.js";
import { catalogue } from "../vocabulary.js";
import { TARGET_PARAMS } from "./guide/model.js";
import { shapeKey } from "./live.js";
import { originOf } from "./origins.js";

/** @typedef {import("../params.js").Wish} Wish */

/** What a job says of its own asset, and the form has no field for. */
const FILE_PARAMS = ["handles", "exclude", ...TARGET_PARAMS];

export class Beginning {
  /** @param {import("./view.js").Workbench} bench @param {string | null} from The id of a job, or what `origins.js` makes. */
  constructor(bench, from) {
    this.bench = bench;
    this.from = from;
    /** Whether the form is filled: what changes from then on is the user's. */
    this.over = false;
    /** Settled once it is known what the server takes. @type {Promise<void>} */
    this.learnt = Promise.resolve();
    this.outputDefaults = /** @type {Record<string, any>} */ ({});
    /** The files that what is kept of a job holds for. */
    this.keptFor = "";
    /** The asset with which the form began, and the thread of versions that a job on it belongs to. */
    this.origin = { asset: /** @type {Asset | null} */ (null), thread: "" };
    /** Files of the job with which the form begins, besides its asset. @type {Record<string, Asset>} */
    this.others = {};
    /** The file of what the example became with which the form begins; empty: there is none. */
    this.made = "";
    const again = chip("Start over", () => this._startOver());
    this.restored = h("div", { class: "kept small muted", hidden: true }, h("p", null, "Your draft is back."), again);
  }

  /** Fill the form. @param {string | null} from As that of the constructor. */
  async begin(from) {
    const { bench } = this;
    const { scope, prompt, parts, settings } = bench;
    if (!DEMO) this.learnt = this._learn();
    if (bench.shared) return this._openShared();
    const models = client.models(scope.signal).catch(() => ({}));
    const last = bench.panel ? null : await lastDraft();
    if (scope.over) return;
    // The draft of another job is not the one that is asked for.
    const draft = last && (!from || last.from === from) ? last : null;
    this.from = from ?? draft?.from ?? null;
    // With nothing to restore, what is typed counts at once: the first asset may take as long as it likes.
    this.over = !draft && !from;
    if (this.over && prompt.value) bench.changed();
    if (draft?.wish.prompt && !prompt.value) prompt.set(draft.wish.prompt);
    const first = this._firstAsset(draft, from);
    const found = catalogue(await models);
    const known = found.shapes ?? found.models.find(({ vocabulary }) => vocabulary)?.vocabulary;
    await this.learnt;
    if (scope.over) return;
    parts.line.offer(known?.groups ?? []);
    parts.corrector.known = Object.values(known?.parts ?? {}).flat();
    if (found.models.length) settings.offer(found);
    settings.restore({ ...settings.wish(""), byShape: settings.usuallyByShape });
    if (draft) bench.restore({ ...draft.wish, prompt: prompt.value }, draft.files ?? {});
    this.over ||= draft !== null; // its asset may take longer, and what is typed meanwhile counts
    this.restored.hidden = !(draft?.stored && (draft.wish.prompt || Object.keys(draft.files ?? {}).length));
    const wish = await first;
    if (scope.over) return;
    if (wish) bench.restore(wish, this.others);
    if (wish && this.made) this._knowMade(this.made);
    this._end(bench.requests.key);
  }

  /** The form is filled. @param {string} key Of what it asks for. */
  _end(key) {
    this.over = true;
    if (this.bench.panel) this.bench.shown.is(key);
    this.bench.changed();
    this.bench.shown.draw();
  }

  /** What an example became is what its form asks for, and is here already. @param {string} name Of its file. */
  _knowMade(name) {
    const { live, requests, prompt, scope } = this.bench;
    const load = async () => (await exampleAsset(name, scope.signal)).bytes();
    live.know({ key: requests.key, label: prompt.value, load, strength: 1, tag: "Result" });
  }

  /** What a link shows: the asset and the shapes of the job. */
  async _openShared() {
    const { scope, assets, check, panel } = this.bench;
    const { job } = /** @type {import("../job/panel.js").JobPanel} */ (panel);
    const bytes = await client.bytes(`v1/jobs/${job.id}/asset`, { signal: scope.signal }).catch((error) => void (isAbort(error) || fill(check.problem, problemBox(error))));
    if (!bytes || scope.over) return;
    await assets.use(new Asset(new Blob([bytes]), job.asset.filename));
    if (!scope.over) this._end(shapeKey(job.id, 0));
  }

  /**
   * @param {import("../drafts.js").Draft | null} draft
   * @param {string | null} from
   * @returns {Promise<Wish | null>} The settings that belong to the asset.
   */
  async _firstAsset(draft, from) {
    const { assets } = this.bench;
    if (assets.choices) return null; // the user was faster
    if (from && !draft) return this._assetOf(from);
    await (draft?.asset ? assets.use(draft.asset) : assets.example());
    return null;
  }

  /** Use the asset of a job, or of an example. @param {string} from @returns {Promise<Wish | null>} Its settings. */
  async _assetOf(from) {
    const { assets, scope, check, panel } = this.bench;
    const before = assets.choices;
    try {
      const { job, asset, others, result = "" } = await originOf(from, scope.signal);
      this.others = others;
      this.made = result;
      this.origin = { asset, thread: job.id ? threadOf(job) : "" };
      if (assets.choices === before) await assets.use(asset);
      await this.learnt;
      return wishOf(job, this.outputDefaults);
    } catch (error) {
      if (isAbort(error)) return null;
      fill(check.problem, problemBox(error));
      if (!panel) await assets.example();
      return null;
    }
  }

  /** The thread of versions to which a job on an asset belongs; empty: none. @param {Asset} asset */
  threadOf(asset) {
    return asset === this.origin.asset ? this.origin.thread : "";
  }

  async _startOver() {
    const { settings, control, guide, prompt, assets } = this.bench;
    await forgetDrafts();
    this.restored.hidden = true;
    this.from = null;
    this.over = false;
    settings.reset();
    control.restore(null);
    guide.restore(null, {});
    prompt.set("");
    await assets.example();
    this.over = true;
    prompt.input.focus();
  }

  async _learn() {
    const { scope, settings } = this.bench;
    const schema = await client.json("web/parameters.json", { signal: scope.signal }).catch(() => null);
    learnNames(schema);
    this.outputDefaults = schema?.["x-output"] ?? {};
    settings.learn(schema);
  }

  /** Nothing that a job said of its own files holds for others. @param {string} asset */
  forgetKept(asset) {
    if (!this.over) return;
    const { settings, guide } = this.bench;
    const targets = guide.meshes.map(({ name, size }) => fileKey(name, size)).join();
    const [before, other] = this.keptFor.split("\n");
    if (before && before !== asset) settings.forget(FILE_PARAMS);
    if (this.keptFor && other !== targets) settings.forget(TARGET_PARAMS);
    this.keptFor = `${asset}\n${targets}`;
  }
}
