// @ts-check
/** The form for a new job. */
import { toast } from "../announce.js";
import { client, errorsOf, isAbort, MeshdeformError } from "../client.js";
import { fill, h } from "../dom.js";
import { forgetDrafts, keepDraft, lastDraft } from "../drafts.js";
import { exampleSection } from "../examples/gallery.js";
import { estimateWords, percent } from "../format.js";
import { recentJobs } from "../jobs/card.js";
import { showOutlook } from "../outlook.js";
import { documents, fileKey, formOf, wishOf } from "../params.js";
import { described, problemBox } from "../problem-box.js";
import { isAboutNegative, isAboutPrompt } from "../refusal.js";
import { routeHash } from "../router.js";
import { debounced } from "../scope.js";
import { catalogue } from "../vocabulary.js";
import { AssetPanel, EXAMPLES } from "./asset-panel.js";
import { controlParams, isEmpty, readingOf } from "./control/model.js";
import { ControlPanel } from "./control/panel.js";
import { intro, JobForm, kindsNav } from "./form.js";
import { Live } from "./live.js";
import { GuidePanel } from "./guide/panel.js";
import { EXEMPLAR, guideParams } from "./guide/model.js";
import { FrontControl } from "./front-control.js";
import { threadOf } from "../job/versions.js";
import { originOf } from "./origins.js";
import { PartsControl } from "./parts/control.js";
import { PromptField } from "./prompt-field.js";
import { SettingsPanel } from "./settings-panel.js";
import { WayChoice } from "./way-choice.js";

/** @typedef {import("../assets.js").Asset} Asset */

export class CreateView {
  /**
   * @param {HTMLElement} root
   * @param {import("../scope.js").Scope} scope
   * @param {string | null} from A job to begin with, or an example (`exampleOrigin`).
   */
  constructor(root, scope, from) {
    this.scope = scope;
    this.from = from;
    /** Whether the form is filled: what changes from then on is the user's. */
    this.begun = false;
    this.steps = /** @type {number | null} */ (null);
    this.checks = 0;
    /** What the last check could tell the outlook of, as `_goal` has it; empty: of nothing. */
    this.foreseen = "";
    /** The asset of the job that was sent last. @type {Asset | null} */
    this.sent = null;
    /** What the form offers under Advanced. @type {Promise<import("../params.js").Field[]>} */
    this.fields = Promise.resolve([]);
    /** Files of the job that the form begins with, besides its asset. @type {Record<string, Asset>} */
    this.others = {};
    /** The asset of the job that the form begins with, and the thread of versions that a job on it belongs to. */
    this.begunWith = { asset: /** @type {Asset | null} */ (null), thread: "" };
    this.outputDefaults = /** @type {Record<string, any>} */ ({});
    this.check = debounced(() => this._check(), 450, scope);
    this.assets = new AssetPanel(scope, () => this._changed());
    this.front = new FrontControl(
      this.assets.box,
      (value) => {
        this.settings.setValue("orientation", value);
        this._changed();
      },
    );
    this.control = new ControlPanel(this.assets.box, () => this._changed());
    this.assets.addBelow(this.control.toolbar);
    this.prompt = new PromptField(() => this._changed());
    this.way = new WayChoice(() => {
      this._offer(this.settings.chosen);
      this._changed();
    });
    this.outlook = h("div", { class: "outlook", "aria-live": "polite", hidden: true });
    const turn = () => {
      this.more.open = true;
      this.front.input.focus();
    };
    this.parts = new PartsControl(this.assets.box, this.control, this.front, scope, (prompt, signal) => this._parts(prompt, signal), (prompt) => this.prompt.set(prompt), turn);
    this.parts.onRead = () => this._foresee();
    this.live = new Live(this.assets.box, scope, (form, seeds, signal) => this._previewed(form, seeds, signal), (seed) => {
      this.settings.seed.input.value = String(seed);
      this._changed();
    }, () => this.control.view.reshape());
    this.assets.onShown = () => {
      this._suitParts();
      this._suitLive();
      this._suitRig([]);
    };
    this.assets.addBelow(this.live.element);
    this.assets.addBelow(this.parts.element);
    this.guide = new GuidePanel(this.assets, this.control.view, scope, () => this._changed());
    this.assets.guide = (files) => this.guide.take(files);
    this.settings = new SettingsPanel(() => this._changed(), (model) => this._offer(model));
    this.inUse = h("span", { class: "small muted" });
    this.more = h("details", { class: "advanced further-options" }, h("summary", null, "More options ", this.inUse), this.control.further.element, this.guide.element, this.front.element, this.settings.further, this.control.element);
    // A fold within it that opens by itself has something to say.
    this.more.addEventListener("toggle", (event) => event.target instanceof HTMLDetailsElement && (this.more.open ||= event.target.open), true);
    this.estimate = h("p", { class: "estimate", id: "estimate", "aria-live": "off" });
    this.problem = h("div", { class: "problem-slot" });
    const over = h("button", { type: "button", class: "chip chip-small", on: { click: () => this._startOver() } }, "Start over");
    this.restored = h("div", { class: "kept small muted", hidden: true }, h("p", null, "Your draft is back."), over);
    /** Stops the check under way, which is out of date. */
    this.checking = new AbortController();
    scope.add(() => this.checking.abort());
    this.form = new JobForm(scope, "New job", "Deform", { ready: () => this._ready(), send: () => this._send(), refuse: (error) => this._refuse(error) });
    this.form.button.setAttribute("aria-describedby", "estimate");
    this.form.element.append(
      this.restored,
      this.prompt.element,
      this.outlook,
      this.way.element,
      this.problem,
      this.settings.element,
      this.more,
      h("div", { class: "start-bar" }, this.estimate, this.form.button),
    );
    fill(
      root,
      intro("Describe what it", "should become", "Reshape your 3D assets with a prompt. Materials, UVs and animations are kept."),
      kindsNav("create"),
      h("div", { class: "create" }, this.assets.element, this.form.element),
      recentJobs(scope),
      exampleSection(scope),
    );
    this._begin(from);
  }

  /** @param {string | null} from */
  async _begin(from) {
    this.fields = this._learnFields();
    const models = client.models(this.scope.signal).catch(() => ({}));
    const last = await lastDraft();
    if (this.scope.over) return;
    // The draft of another job is not the one that is asked for.
    const draft = last && (!from || last.from === from) ? last : null;
    this.from = from ?? draft?.from ?? null;
    // With nothing to restore, what is typed counts at once: the first asset may take as long as it likes.
    this.begun = !draft && !from;
    if (this.begun && this.prompt.value) this._changed();
    if (draft?.wish.prompt && !this.prompt.value) this.prompt.set(draft.wish.prompt);
    const first = this._firstAsset(draft, from);
    const found = catalogue(await models);
    const known = found.shapes ?? found.models.find(({ vocabulary }) => vocabulary)?.vocabulary;
    await this.fields;
    if (this.scope.over) return;
    this.parts.line.offer(known?.groups ?? []);
    this.parts.corrector.known = Object.values(known?.parts ?? {}).flat();
    this.way.set(this._usuallyByShape(found));
    if (found.models.length) this.settings.offer(found);
    if (draft) this._restore({ ...draft.wish, prompt: this.prompt.value }, draft.files ?? {});
    this.begun ||= draft !== null; // its asset may take longer, and what is typed meanwhile counts
    this.restored.hidden = !(draft?.stored && (draft.wish.prompt || Object.keys(draft.files ?? {}).length));
    const wish = await first;
    if (this.scope.over) return;
    if (wish) this._restore(wish, this.others);
    this.begun = true;
    this._changed();
  }

  /**
   * @param {import("../drafts.js").Draft | null} draft
   * @param {string | null} from
   * @returns {Promise<import("../params.js").Wish | null>} The settings that belong to the asset.
   */
  async _firstAsset(draft, from) {
    if (this.assets.choices) return null; // the user was faster
    if (from && !draft) return this._assetOf(from);
    await (draft?.asset ? this.assets.use(draft.asset) : this.assets.example(EXAMPLES[0].name));
    return null;
  }

  async _startOver() {
    await forgetDrafts();
    this.restored.hidden = true;
    this.from = null;
    this.begun = false;
    this.settings.reset();
    this.control.restore(null);
    this.guide.restore(null, {});
    this._useWay(this._usuallyByShape(this.settings.catalogue));
    this.prompt.set("");
    await this.assets.example(EXAMPLES[0].name);
    this.begun = true;
    this.prompt.input.focus();
  }

  /** @param {import("../vocabulary.js").Model | null} model */
  _offer(model) {
    const { models, shapes } = this.settings.catalogue;
    const others = models.some((found) => found.id !== model?.id && found.available && !found.vocabulary);
    const { byShape } = this.way;
    // Whatever the model: no model is asked for what there are shapes of. Servers without a list have that of the built-in one.
    const builtin = models.find(({ id }) => id === "builtin") ?? model;
    this.prompt.offer(!byShape ? model : builtin && shapes ? { ...builtin, vocabulary: shapes } : builtin, others, byShape);
  }

  /** Whether the server fits to shapes where nobody chooses: unless its operator has named a model. @param {import("../vocabulary.js").Catalogue} catalogue */
  _usuallyByShape({ default: model }) {
    return model === "builtin";
  }

  /** @param {boolean} byShape */
  _useWay(byShape) {
    this.way.set(byShape);
    this._offer(this.settings.chosen);
  }

  /** @returns {Promise<import("../params.js").Field[]>} */
  async _learnFields() {
    const schema = await client.json("web/parameters.json", { signal: this.scope.signal }).catch(() => null);
    const form = formOf(schema);
    this.outputDefaults = schema?.["x-output"] ?? {};
    this.settings.offerFields(form);
    this.way.offer(EXEMPLAR in form.groups.guidance);
    this.settings.offerRig(this.outputDefaults.rig);
    this.front.offer(this.settings.offers("orientation"));
    return form.fields;
  }

  /** Use the asset of a job, or of an example. @param {string} from @returns {Promise<import("../params.js").Wish | null>} Its settings. */
  async _assetOf(from) {
    const before = this.assets.choices;
    try {
      const { job, asset, others } = await originOf(from, this.scope.signal);
      this.others = others;
      this.begunWith = { asset, thread: job.id ? threadOf(job) : "" };
      if (this.assets.choices === before) await this.assets.use(asset);
      return wishOf(job, await this.fields, this.outputDefaults);
    } catch (error) {
      if (isAbort(error)) return null;
      fill(this.problem, problemBox(error));
      await this.assets.example(EXAMPLES[0].name);
      return null;
    }
  }

  /** @param {import("../params.js").Wish} wish @param {Record<string, Asset>} files */
  _restore(wish, files) {
    this.settings.restore(wish);
    this.control.restore(wish.control);
    this.guide.restore(wish.guide, files);
    this._useWay(wish.byShape ?? false);
    this.prompt.set(wish.prompt);
  }

  _changed() {
    const { asset } = this.assets;
    const key = asset ? fileKey(asset.name, asset.size) : "";
    // The angle that was said of another file.
    if (this.begun && key && this.control.asset && key !== this.control.asset && this._said().advanced.orientation) this.settings.setValue("orientation", "");
    this.front.show(this.settings.value("orientation"));
    if (key) this.control.assetIs(key);
    this._suitParts();
    this.control.view.exclude(this.settings.kept.params.exclude ?? []);
    if (this.begun) keepDraft({ from: this.from, wish: { ...this.settings.draft(this.prompt.input.value), byShape: this.way.byShape, control: this.control.value(), guide: this.guide.value() }, asset, files: this.guide.parts });
    this.prompt.element.hidden = this.control.further.element.hidden = this.guide.target !== null;
    const targets = this.guide.meshes.length;
    this.way.suit(targets);
    this.guide.suit(this.way.byShape);
    const { guidance = "sds" } = guideParams(this.guide.guide, targets, this.prompt.value || (this.control.further.any ? "further" : ""), this.way.byShape);
    this.settings.suit(guidance);
    this.front.offer(this.settings.offers("orientation"));
    if (this.foreseen !== this._goal()) this._showOutlook(null);
    const used = this._usesMore();
    if (used && !this.inUse.textContent) this.more.open = true;
    this.inUse.textContent = used ? "· in use" : "";
    const { variationCount, variations } = this.settings;
    const named = variationCount > 1 && Number(variations.input.value) === variationCount; // none that the field refuses
    this._suitLive();
    this.form.rename(named ? `Deform, ${variationCount} variations` : "Deform");
    this.check();
  }

  /** Ask what becomes of the rig, where there is one. @param {any[]} joints That the server has found. */
  _suitRig(joints) {
    this.settings.rigRow.hidden = !joints.length && !this.assets.box.viewer?.rigged;
  }

  /** Let the parts be those of the asset, as a prompt for the chosen model can name them. */
  _suitParts() {
    const { asset, shown } = this.assets;
    const { model, kept } = this.settings.wish("");
    const of = asset && asset === shown && !this.guide.target ? JSON.stringify([this.assets.choices, asset.name, asset.size, model, kept.params]) : "";
    const { control, advanced } = this._said();
    const said = Object.entries({ ...controlParams(control), ...advanced });
    this.parts.suit(of, said.length ? JSON.stringify(said) : "", this.prompt.value);
  }

  /** What a person said of what the asset is. @returns {Pick<import("../params.js").Wish, "advanced"> & {control: import("./control/model.js").Control}} */
  _said() {
    const front = this.settings.value("orientation");
    return { control: readingOf(this.control.control), advanced: Number.isFinite(Number(front || NaN)) ? { orientation: front } : {} };
  }

  /** @param {string} prompt @param {AbortSignal} signal @returns {Promise<any>} The parts of the asset, or those of the prompt and what it makes. */
  async _parts(prompt, signal) {
    const asset = /** @type {Asset} */ (this.assets.asset);
    const document = documents({ ...this.settings.wish(prompt), ...this._said(), variations: 1 }, null, "", this.settings.offered)[0];
    return client.parts(...(await asset.submission(document, {}, signal)));
  }

  /** Let the view show what the form asks for, as far as that takes no model. */
  _suitLive() {
    const { asset, shown } = this.assets;
    const wish = this._liveWish();
    const seen = asset && asset === shown && this.begun && this.way.byShape && this.guide.isEmpty && !wish.subdivide && !this._aimless(wish) && !this.parts.wanted.length;
    const { seed: _, ...goal } = { ...wish, seed: 0 };
    this.live.suit(seen ? JSON.stringify([this.assets.choices, asset.name, asset.size, goal]) : "", wish.seed, Number(this.settings.strength.value || this.settings.strength.usual / 100));
  }

  /** What a preview is asked for: a slider shows the shares of its way. */
  _liveWish() {
    const wish = this._wish();
    return { ...wish, variations: 1, advanced: { ...wish.advanced, [this.settings.strength.name]: "" } };
  }

  /** @param {"glb" | "positions"} form @param {number[]} seeds @param {AbortSignal} signal @returns {Promise<ArrayBuffer>} */
  async _previewed(form, seeds, signal) {
    const asset = /** @type {Asset} */ (this.assets.asset);
    const { metadata: _, ...document } = { metadata: null, ...documents(this._liveWish(), null, "", this.settings.offered)[0], seeds };
    if (asset.kept) {
      try {
        return (await client.preview({ sha256: asset.kept, filename: asset.name }, document, { as: form, signal })).data;
      } catch (error) {
        if (!(error instanceof MeshdeformError && error.code === "asset_not_kept")) throw error;
      }
    }
    const [sent, , more] = await asset.submission(document, {}, signal);
    const made = await client.preview(sent, document, { ...more, as: form });
    asset.kept = made.asset;
    return made.data;
  }

  /** Show that the job cannot start yet; the button still leads to what is wrong. @param {boolean} on */
  _block(on) {
    this.form.button.classList.toggle("button-blocked", on);
  }

  _wish() {
    return { ...this.settings.wish(this.prompt.value), byShape: this.way.byShape, control: this.control.value(), guide: this.guide.value() };
  }

  /** Whether nothing says yet what the asset should become. @param {import("../params.js").Wish} wish */
  _aimless(wish) {
    return !wish.prompt && !this.control.further.any && this.guide.isEmpty;
  }

  /** Return whether all settings can be sent; what cannot is marked. */
  _settle() {
    const found = [this.settings.check(), this.control.check(this.settings.subdivide.checked), this.guide.check()];
    this._unfoldProblems();
    return found.every(Boolean);
  }

  _unfoldProblems() {
    if (this.more.querySelector('[aria-invalid="true"], .field-problem:not([hidden])')) this.more.open = true;
  }

  /** Whether the fold holds anything that the job will have. */
  _usesMore() {
    return !this.guide.isEmpty || !isEmpty(this.control.control) || this.control.control.prompts.length > 0 || this.settings.furtherInUse;
  }

  async _check() {
    const asset = this.assets.asset;
    const wish = this._wish();
    this.checks += 1;
    const turn = this.checks;
    this.checking.abort();
    this.checking = new AbortController();
    const good = this._settle();
    this._block(!good);
    if (!good) {
      this.estimate.textContent = "Correct the marked settings.";
      return;
    }
    if (!asset || this._aimless(wish)) {
      this.prompt.refuse(null);
      this.estimate.textContent = wish.prompt ? "" : "Enter a prompt, or pick one.";
      return;
    }
    // What is quick needs no word.
    const say = (/** @type {string} */ text) => turn === this.checks && (this.estimate.textContent = text);
    const slow = setTimeout(say, 400, "Checking…");
    asset.onProgress = (share) => (clearTimeout(slow), say(share < 1 ? `Uploading, ${percent(share)}` : "Checking…"));
    try {
      const document = documents({ ...wish, variations: 1 }, this.steps, "", this.settings.offered)[0];
      const found = await client.validate(...(await asset.submission(document, this.guide.parts, this.checking.signal)));
      if (turn !== this.checks || this.scope.over) return;
      this._good(found, wish);
    } catch (error) {
      if (turn === this.checks && !this.scope.over && !isAbort(error)) this._refused(error);
    } finally {
      clearTimeout(slow);
    }
  }

  /** What an outlook depends on. */
  _goal() {
    const { asset } = this.assets;
    return JSON.stringify([this.way.byShape, this.prompt.value, this.guide.meshes.length, asset?.name, asset?.size]);
  }

  /** Check again once the asset has been read, which the outlook needs. */
  _foresee() {
    if (this.way.byShape && !this.foreseen) this.check();
  }

  /** @param {import("../outlook.js").Outlook | null} outlook Null: it is not known. */
  _showOutlook(outlook) {
    this.foreseen = outlook ? this._goal() : "";
    // A target takes the place of the prompt.
    showOutlook(this.outlook, outlook && this.guide.target ? { ...outlook, suggestions: [] } : outlook, (prompt) => {
      this.prompt.set(prompt);
      this.prompt.input.focus();
    });
  }

  /** @param {any} found @param {import("../params.js").Wish} wish */
  _good(found, wish) {
    this.steps = found.params.steps;
    this._showOutlook(found.outlook ?? null);
    this.prompt.refuse(null);
    this.control.further.accept();
    fill(this.problem);
    this.settings.resolved(found.params);
    this.front.resolve(found.params.orientation);
    const { triangles, vertices, meshes, joints, skipped, warnings } = found.asset;
    this._suitRig(joints);
    const more = [meshes > 1 ? `${meshes} meshes` : "", skipped.length ? `${skipped.length} left as they are` : ""].filter(Boolean);
    this.control.offer(found.asset);
    this.assets.describe(triangles, vertices, more, warnings);
    fill(this.estimate, estimateWords(found, wish.variations));
  }

  /** @param {unknown} error */
  _refused(error) {
    this._place(error);
    this._unfoldProblems();
  }

  /** Say what was refused beside it. @param {unknown} error */
  _place(error) {
    this.estimate.textContent = "";
    const code = error instanceof MeshdeformError ? error.code : "";
    const about = isAboutPrompt(error) && error instanceof MeshdeformError;
    const further = about && this.control.further.refuse(error, !this.prompt.value);
    if (!further) this.control.further.accept();
    if (!further && about && isAboutNegative(error, this.prompt.value)) {
      this.prompt.refuse(null);
      return void this.settings.refuse([{ loc: ["negative_prompt"], msg: error.message }]);
    }
    this._block(true);
    this.prompt.refuse(about && !further ? error : null);
    if (about) return void fill(this.problem);
    if (code.startsWith("asset_") && error instanceof MeshdeformError) {
      const fit = h("a", { class: "chip", href: routeHash({ name: "surface", from: null, quick: true }) }, "Fit a surface to it");
      const { surface } = error.problem; // points, a grid or a network
      this.assets.refuse(error.message, surface ? "Fit one first, and deform the mesh that it becomes." : error.advice);
      return void fill(this.problem, surface ? fit : null);
    }
    if (error instanceof MeshdeformError && error.status === 404) for (const file of [this.assets.asset, ...Object.values(this.guide.parts)]) file?.forgetUpload();
    if (error instanceof MeshdeformError && this.guide.refuse(error)) return void fill(this.problem);
    const errors = errorsOf(error);
    const placed = errors.length > 0 && (this.control.refuse(errors) || this.settings.refuse(errors));
    fill(this.problem, placed ? null : problemBox(error));
  }

  /** Return whether jobs can start; what is wrong has the focus. */
  _ready() {
    if (this._aimless(this._wish())) {
      this.prompt.refuse("Enter a prompt first.");
      this.prompt.input.focus();
    } else if (!this._settle()) {
      const at = /** @type {HTMLElement | null} */ (this.more.querySelector('[aria-invalid="true"]'));
      if (at) at.focus();
      else (this.guide.check() ? this.control : this.guide).focusProblem();
    } else return this.assets.asset !== null;
    return false;
  }

  /** @param {unknown} error */
  _refuse(error) {
    if (this.sent !== this.assets.asset) return; // that file has given way to another
    this._refused(error);
    if (this.prompt.input.hasAttribute("aria-invalid")) this.prompt.input.focus();
    else if (this.control.further.refused.size) this.control.further.focusProblem();
  }

  async _send() {
    this.checks += 1; // an answer under way is out of date
    const asset = (this.sent = /** @type {Asset} */ (this.assets.asset));
    const wish = this._wish();
    const { parts } = this.guide;
    // A preset chosen a moment ago has other steps than the last check knew.
    const wanted = documents({ ...wish, variations: 1 }, null, "", this.settings.offered)[0];
    const checked = await client.validate(...(await asset.submission(wanted, parts)));
    this.steps = checked.params.steps;
    const group = "g" + Date.now().toString(36) + Math.floor(Math.random() * 1e6).toString(36);
    /** @type {any[]} */
    const jobs = [];
    for (const document of documents(wish, this.steps, group, this.settings.offered, this.prompt.model?.vocabulary ?? null)) {
      if (asset === this.begunWith.asset && this.begunWith.thread) document.metadata = { ...document.metadata, thread: this.begunWith.thread };
      try {
        jobs.push(await client.submit(...(await asset.submission(document, parts))));
      } catch (error) {
        if (!jobs.length) throw error;
        // Some were accepted: show those, and say what became of the others.
        toast(`${jobs.length} of ${wish.variations} jobs started. ${described(error).detail || described(error).title}`);
        break;
      }
    }
    return wish.variations > 1 ? routeHash({ name: "group", id: group }) : routeHash({ name: "job", id: jobs[0].id });
  }
}
