// @ts-check
/**
 * The workbench: the asset as large as the window allows, words beside it, and at once the shape that they stand for. The
 * page of a job is the same workbench, with that job's state.
 */
import { Asset, exampleAsset } from "../assets.js";
import { client, errorsOf, isAbort, MeshdeformError } from "../client.js";
import { DEMO } from "../demo.js";
import { fill, h } from "../dom.js";
import { forgetDrafts, keepDraft, lastDraft } from "../drafts.js";
import { exampleSection } from "../examples/gallery.js";
import { count, estimateWords, goalWords, percent } from "../format.js";
import { isTerminal } from "../history.js";
import { recentJobs } from "../jobs/card.js";
import { JobPanel } from "../job/panel.js";
import { isDeformation, shapesOf } from "../job/shapes.js";
import { threadOf, versionShapes } from "../job/versions.js";
import { currentLink } from "../key.js";
import { showOutlook } from "../outlook.js";
import { documentOf, fileKey, wishOf } from "../params.js";
import { learnNames } from "../plain.js";
import { problemBox } from "../problem-box.js";
import { isAboutPrompt } from "../refusal.js";
import { routeHash } from "../router.js";
import { snippetsBlock } from "../snippets.js";
import { debounced } from "../scope.js";
import { catalogue } from "../vocabulary.js";
import { movingControls } from "../viewer-box.js";
import { AssetPanel, EXAMPLES } from "./asset-panel.js";
import { Comparison } from "./comparison.js";
import { controlParams, isEmpty, readingOf } from "./control/model.js";
import { ControlPanel } from "./control/panel.js";
import { Downloads } from "./downloads.js";
import { JobForm, kindsNav } from "./form.js";
import { Live, shapeKey } from "./live.js";
import { GuidePanel } from "./guide/panel.js";
import { guideParams, TARGET_PARAMS } from "./guide/model.js";
import { originOf } from "./origins.js";
import { PartsControl } from "./parts/control.js";
import { PromptField } from "./prompt-field.js";
import { SettingsPanel } from "./settings-panel.js";
import { ShapeStrip } from "./shape-strip.js";

/** @typedef {import("./live.js").Shape} Shape */

/** What a job says of its own asset, and the form has no field for. */
const FILE_PARAMS = ["handles", "exclude", ...TARGET_PARAMS];

export class Workbench {
  // What `_assets` and `_words` make.
  /** @type {AssetPanel} */ assets;
  /** @type {ControlPanel} */ control;
  /** @type {Live} */ live;
  /** @type {Comparison} */ comparison;
  /** @type {ShapeStrip} */ strip;
  /** @type {PromptField} */ prompt;
  /** @type {HTMLElement} */ outlook;
  /** @type {PartsControl} */ parts;
  /** @type {GuidePanel} */ guide;
  /** @type {SettingsPanel} */ settings;
  /** @type {HTMLElement} */ estimate;
  /** @type {HTMLElement} */ problem;
  /** @type {HTMLElement} */ restored;
  /** @type {HTMLButtonElement} */ starts;
  /** @type {Downloads} */ downloads;
  /** @type {JobForm} */ form;
  /** @type {JobPanel | null} */ panel;
  /** @type {HTMLDetailsElement} The request as code to copy. */ code;
  /** @type {HTMLElement} */ program;
  /** @type {HTMLElement} */ inUse;
  /** @type {HTMLDetailsElement} */ more;

  /**
   * @param {HTMLElement} root
   * @param {import("../scope.js").Scope} scope
   * @param {object} [begin]
   * @param {string | null} [begin.from] A job to begin with, or an example (`exampleOrigin`).
   * @param {any} [begin.job] A deformation, whose state is shown.
   * @param {string} [begin.against] A job whose result stands beside it.
   */
  constructor(root, scope, { from = null, job = null, against = "" } = {}) {
    this.scope = scope;
    this.from = job ? job.id : from;
    /** Whether who looks came by a link, and makes nothing. */
    this.shared = currentLink() !== "";
    /** Whether the form is filled: what changes from then on is the user's. */
    this.begun = false;
    this.steps = /** @type {number | null} */ (null);
    this.checks = 0;
    /** What the last check could tell the outlook of, as `_goal` has it; empty: of nothing. */
    this.foreseen = "";
    /** The asset of the job that was sent last. @type {Asset | null} */
    this.sent = null;
    /** Settled once it is known what the server takes. @type {Promise<void>} */
    this.learnt = Promise.resolve();
    /** The files that what is kept of a job holds for. */
    this.keptFor = "";
    /** Files of the job that the form begins with, besides its asset. @type {Record<string, Asset>} */
    this.others = {};
    /** The asset of the job that the form begins with, and the thread of versions that a job on it belongs to. */
    this.begunWith = { asset: /** @type {Asset | null} */ (null), thread: "" };
    /** The file of what the example became with which the form begins; empty: there is none. */
    this.made = "";
    this.outputDefaults = /** @type {Record<string, any>} */ ({});
    /** What the form asks for where it asks for the job that is shown, as `shapeKey` has it. */
    this.jobKey = "";
    /** And the strength that it had, and all of it. */
    this.jobStrength = 1;
    this.jobWish = /** @type {any} */ (null);
    /** Shapes that the job has, and those of other versions. */
    this.offered = { steps: /** @type {number[]} */ ([]), finished: false, lastStep: 0 };
    /** @type {Shape[]} */
    this.versions = [];
    /** The step of the job from which another one starts. @type {number | null} */
    this.start = null;
    this.check = debounced(() => this._check(), 450, scope);
    /** Stops the check under way, which is out of date. */
    this.checking = new AbortController();
    scope.add(() => this.checking.abort());
    this._assets(job);
    this._words();
    this._build(root, job);
    if (job) this._attach(job, against);
    this._begin(job ? job.id : from);
  }

  /** The asset, and what the view shows of it. @param {any} job */
  _assets(job) {
    const { scope } = this;
    this.assets = new AssetPanel(scope, () => this._changed(), job === null);
    this.control = new ControlPanel(this.assets.box, () => this._changed());
    this.live = new Live(this.assets.box, scope, {
      ask: (form, seed, signal, draft) => this._asked(this._liveWish(), form, seed, signal, draft),
      take: (seed) => {
        this.settings.seed.input.value = String(seed);
        this._changed();
      },
      reshaped: () => this.parts.reshaped(this.live.shape !== null),
      shown: (shape) => this._shown(shape),
      label: () => this.prompt.value || "Target",
    });
    this.comparison = new Comparison(this.assets, scope);
    this.strip = new ShapeStrip(scope, (shape) => this._take(shape), () => this.comparison.choices(this.strip.shapes));
    this.assets.addBelow(this.control.toolbar);
    this.assets.addBelow(this.comparison.element);
    this.assets.addBelow(movingControls(scope, [this.comparison.box, this.assets.box], (ending) => `turntable.${ending}`));
    this.assets.onShown = () => {
      this.strip.begin(this.assets.asset?.print ?? "");
      this._suitParts();
      this._suitLive();
      this._suitRig([]);
      this._offerKeep();
    };
  }

  /** What it should become. */
  _words() {
    const { scope } = this;
    this.prompt = new PromptField(() => this._changed());
    this.outlook = h("div", { class: "outlook", "aria-live": "polite", hidden: true });
    this.parts = new PartsControl(this.assets.box, this.control, scope, {
      ask: (signal) => this._parts(signal),
      change: async (prompt, form, signal) => (await this._asked(this._saidWish(prompt), form, this._wish().seed, signal)).data,
      write: (prompt) => this.prompt.set(prompt),
    });
    this.parts.onRead = () => this._foresee();
    this.guide = new GuidePanel(this.assets, scope, () => this._changed());
    this.assets.guide = (files) => this.guide.take(files);
    this.settings = new SettingsPanel(() => this._changed(), (model) => this._offer(model));
    this.estimate = h("p", { class: "estimate", id: "estimate", "aria-live": "off" });
    this.problem = h("div", { class: "problem-slot" });
    const over = h("button", { type: "button", class: "chip chip-small", on: { click: () => this._startOver() } }, "Start over");
    this.restored = h("div", { class: "kept small muted", hidden: true }, h("p", null, "Your draft is back."), over);
    this.starts = h("button", { type: "button", class: "chip chip-small", hidden: true, on: { click: () => this._startFrom(null) } });
    this.downloads = new Downloads(scope, (signal) => this._exact(signal), () => this._fakeJob());
    this.form = new JobForm(scope, "New job", "Keep", { ready: () => this._ready(), send: () => this._send(), refuse: (error) => this._refuse(error) });
    this.form.button.setAttribute("aria-describedby", "estimate");
  }

  /** @param {HTMLElement} root @param {any} job */
  _build(root, job) {
    this.panel = job ? new JobPanel(job, this.scope, { offer: (...shapes) => this._offerShapes(...shapes), finished: (_, artifacts) => this._finished(artifacts) }) : null;
    this.program = h("div", null);
    this.code = h("details", { class: "advanced", on: { toggle: () => this._showCode() } }, h("summary", null, "As code"), this.program);
    this.inUse = h("span", { class: "small muted" });
    const making = this.shared ? [] : [this.settings.element, this.control.element, this.code];
    this.more = h("details", { class: "advanced bench-details", on: { toggle: () => this.control.place() } }, h("summary", null, "Details ", this.inUse), this.panel?.results, this.comparison.view, making, this.panel?.settings);
    const words = [this.restored, this.prompt.element, this.outlook, this.problem, this.parts.element, this.guide.element, this.live.lacks, this.live.element];
    this.form.element.append(
      ...(this.panel ? [this.panel.head, this.panel.top] : [h("h1", null, "Describe what it ", h("em", null, "should become"))]),
      ...(this.shared ? [] : words),
      this.settings.strength.element,
      this.strip.element,
      h("div", { class: "start-bar" }, this.shared ? null : [this.estimate, this.starts], h("div", { class: "row" }, this.downloads.element, this.shared ? null : this.form.button)),
      this.more,
    );
    const around = job ? [] : [kindsNav("create"), recentJobs(this.scope), exampleSection(this.scope)];
    fill(root, h("div", { class: "bench" }, this.assets.element, this.form.element), around);
  }

  /** @param {string | null} from */
  async _begin(from) {
    if (!DEMO) this.learnt = this._learn();
    if (this.shared) return this._openShared();
    const models = client.models(this.scope.signal).catch(() => ({}));
    const last = this.panel ? null : await lastDraft();
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
    await this.learnt;
    if (this.scope.over) return;
    this.parts.line.offer(known?.groups ?? []);
    this.parts.corrector.known = Object.values(known?.parts ?? {}).flat();
    if (found.models.length) this.settings.offer(found);
    this.settings.restore({ ...this.settings.wish(""), byShape: this.settings.usuallyByShape });
    if (draft) this._restore({ ...draft.wish, prompt: this.prompt.value }, draft.files ?? {});
    this.begun ||= draft !== null; // its asset may take longer, and what is typed meanwhile counts
    this.restored.hidden = !(draft?.stored && (draft.wish.prompt || Object.keys(draft.files ?? {}).length));
    const wish = await first;
    if (this.scope.over) return;
    if (wish) this._restore(wish, this.others);
    this.begun = true;
    if (this.panel) this._isOf(this._key());
    if (wish && this.made) this._knowMade(this.made);
    this._changed();
    this._storedShapes();
  }

  /** What an example became is what its form asks for, and is here already. @param {string} name Of its file. */
  _knowMade(name) {
    const load = async () => (await exampleAsset(name, this.scope.signal)).bytes();
    this.live.know({ key: this._key(), label: this.prompt.value, load, strength: 1, tag: "Result" });
  }

  /** What a link shows: the asset and the shapes of the job. */
  async _openShared() {
    const { job } = /** @type {JobPanel} */ (this.panel);
    const bytes = await client.bytes(`v1/jobs/${job.id}/asset`, { signal: this.scope.signal }).catch((error) => void (isAbort(error) || fill(this.problem, problemBox(error))));
    if (!bytes || this.scope.over) return;
    await this.assets.use(new Asset(new Blob([bytes]), job.asset.filename));
    if (this.scope.over) return;
    this.begun = true;
    this._isOf(shapeKey(job.id, 0));
    this._changed();
    this._storedShapes();
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
    this.prompt.set("");
    await this.assets.example(EXAMPLES[0].name);
    this.begun = true;
    this.prompt.input.focus();
  }

  /** @param {import("../vocabulary.js").Model | null} model */
  _offer(model) {
    const { models, shapes } = this.settings.catalogue;
    const others = models.some((found) => found.id !== model?.id && found.available && !found.vocabulary);
    const { byShape } = this.settings;
    // Whatever the model: no model is asked for what there are shapes of. Servers without a list have that of the built-in one.
    const builtin = models.find(({ id }) => id === "builtin") ?? model;
    this.prompt.offer(!byShape ? model : builtin && shapes ? { ...builtin, vocabulary: shapes } : builtin, others, byShape);
  }

  async _learn() {
    const schema = await client.json("web/parameters.json", { signal: this.scope.signal }).catch(() => null);
    learnNames(schema);
    this.outputDefaults = schema?.["x-output"] ?? {};
    this.settings.learn(schema);
  }

  /** Use the asset of a job, or of an example. @param {string} from @returns {Promise<import("../params.js").Wish | null>} Its settings. */
  async _assetOf(from) {
    const before = this.assets.choices;
    try {
      const { job, asset, others, result = "" } = await originOf(from, this.scope.signal);
      this.others = others;
      this.made = result;
      this.begunWith = { asset, thread: job.id ? threadOf(job) : "" };
      if (this.assets.choices === before) await this.assets.use(asset);
      await this.learnt;
      return wishOf(job, this.outputDefaults);
    } catch (error) {
      if (isAbort(error)) return null;
      fill(this.problem, problemBox(error));
      if (!this.panel) await this.assets.example(EXAMPLES[0].name);
      return null;
    }
  }

  /** @param {import("../params.js").Wish} wish @param {Record<string, Asset>} files */
  _restore(wish, files) {
    this.settings.restore(wish);
    this.control.restore(wish.control);
    this.guide.restore(wish.guide, files);
    this.prompt.set(wish.prompt);
  }

  /** What the form asks for now is the job that is shown. @param {string} key */
  _isOf(key) {
    this.jobKey = key;
    this.jobStrength = this.settings.strength.share;
    this.jobWish = this._wish();
  }

  // The job that is shown.

  /** @param {any} job @param {string} against */
  _attach(job, against) {
    this.panel?.follow();
    if (this.shared) return;
    versionShapes(job, this.scope.signal).then(
      (versions) => {
        this.versions = versions;
        this._storedShapes();
        const other = versions.find(({ href }) => href?.endsWith(against));
        if (against) this._against(against, other);
      },
      (error) => isAbort(error) || console.warn(error),
    );
  }

  /** Compare with the result of a job, of this thread or not. @param {string} id @param {Shape | undefined} version */
  async _against(id, version) {
    const path = `v1/jobs/${id}/artifacts/result.glb`;
    let other = version;
    if (!other) {
      const job = await client.get(id, this.scope.signal).catch(() => null);
      if (!job || !isDeformation(job)) return;
      other = { key: path, label: goalWords(job) || job.asset.filename, load: () => client.bytes(path, { signal: this.scope.signal }), strength: 1, tag: "Result", href: routeHash({ name: "job", id }) };
      this.versions = [...this.versions, other];
      this._storedShapes();
    }
    this.comparison.against(other);
  }

  /** @param {number[]} steps @param {boolean} finished @param {number} lastStep */
  _offerShapes(steps, finished, lastStep) {
    this.offered = { steps, finished, lastStep };
    this._storedShapes();
  }

  /** Show the shapes that jobs have; the newest of this one is what its form asks for. */
  _storedShapes() {
    if (!this.panel || !this.jobKey) return this.strip.offer(this.versions);
    const { job } = this.panel;
    const { steps, finished, lastStep } = this.offered;
    const found = shapesOf(job, steps, finished ? lastStep : null);
    const shapes = found.map((each, i) => this._storedShape(each, i === found.length - 1));
    this.strip.offer([...this.versions, ...shapes]);
    const newest = shapes.at(-1);
    if (newest) this.live.know(newest);
    this._offerKeep();
  }

  /** @param {import("../job/shapes.js").Shape} shape @param {boolean} newest @returns {Shape} */
  _storedShape({ path, label, name, step }, newest) {
    const known = this.strip.stored.find(({ stored }) => stored?.path === path);
    return {
      key: newest ? this.jobKey : path,
      label,
      load: () => client.bytes(path, { signal: this.scope.signal }),
      strength: name === "" ? this.jobStrength : 1,
      tag: label,
      picture: known?.picture,
      wish: newest ? this.jobWish : null,
      stored: { path, name, step: name.startsWith("step") ? step : null },
    };
  }

  /** @param {any[]} artifacts Files of the job, which is over. */
  async _finished(artifacts) {
    const { job, state } = /** @type {JobPanel} */ (this.panel);
    if (state === "succeeded") this.downloads.names = artifacts.map((/** @type {any} */ { name }) => name);
    this._suitLive();
    this._offerKeep();
    if (!this.assets.flat || !artifacts.some(({ name }) => name === "preview.png")) return;
    this.assets.showPicture(await client.download(job, "preview.png", { signal: this.scope.signal }));
  }

  /** Whether the form asks for the job that is shown, and not for another one. */
  get _isJob() {
    return this.panel !== null && this.jobKey !== "" && (this.shared || (this._key() === this.jobKey && this.start === null));
  }

  // What is shown.

  /** @param {Shape | null} shape */
  _shown(shape) {
    if (shape && shape.key === this.live.key) shape.wish ??= this._wish();
    this.strip.show(shape);
    this.comparison.offer(shape !== null);
    this.settings.strength.element.hidden = shape === null || !this.live.morphs;
    this._offerKeep();
  }

  /** Go back to a shape. @param {Shape} shape */
  async _take(shape) {
    if (shape.href) return void (location.hash = shape.href);
    this._startFrom(shape.stored?.step ?? null);
    if (!shape.wish || shape.key === this.live.key) return this.live.look(shape);
    this.live.know(shape);
    this._restore(shape.wish, this.guide.parts);
    this._changed();
  }

  /** Let the next job start from a step of the one that is shown. @param {number | null} step */
  _startFrom(step) {
    const from = this.panel && isTerminal(this.panel.job.state) ? step : null;
    this.start = from;
    this.starts.hidden = from === null;
    this.starts.textContent = from === null ? "" : `Starts from step ${count(from)} ✕`;
    this.starts.setAttribute("aria-label", `Starts from step ${from}: start from the asset instead`);
    this._offerKeep();
  }

  /** Offer what can be done with what is shown. */
  _offerKeep() {
    const { panel } = this;
    const state = panel?.state ?? "";
    const running = panel !== null && !isTerminal(state || panel.job.state);
    const done = this._isJob && state === "succeeded";
    this.settings.strength.exaggerate(done && this.live.morphs);
    const { share } = this.live;
    // A job has the strength of a fit; any other result is only shown weaker.
    const same = this.shared || (this._isJob && running) || (done && (!this.settings.byShape || share >= 1));
    this.form.button.hidden = this.estimate.hidden = same;
    this.form.rename(this.start !== null || !this._possible() || !this.live.able ? "Run" : "Keep");
    // Where nothing can be drawn, the result is there all the same.
    const shape = this.live.shape ?? (done && this.assets.flat ? (this.strip.stored.at(-1) ?? null) : null);
    this.downloads.show(shape && { shape, share: this.live.morphs ? share : 1, job: panel?.job ?? null, result: done && shape.key === this.jobKey });
  }

  /** What names the files of a shape that no job has. */
  _fakeJob() {
    return { asset: { filename: this.assets.asset?.name ?? "" }, prompt: this.prompt.value, params: { seed: this._wish().seed } };
  }

  /** The shape as a job would make it, at the strength of the form. @param {AbortSignal} signal @returns {Promise<ArrayBuffer>} */
  async _exact(signal) {
    const { shape, asked } = this.live;
    if (shape && asked.strength === shape.strength) return shape.load();
    return (await this._asked(this._wish(), "glb", asked.seed, signal)).data;
  }

  _changed() {
    const { asset } = this.assets;
    const key = asset ? fileKey(asset.name, asset.size) : "";
    if (this.begun) this._forgetKept(key);
    if (key) this.control.assetIs(key);
    this._suitParts();
    this.control.view.exclude(this.settings.kept.params.exclude ?? []);
    const wish = this._wish();
    if (this.begun && !this.panel) keepDraft({ from: this.from, wish: { ...wish, prompt: this.prompt.input.value }, asset, files: this.guide.parts });
    this.prompt.element.hidden = this.guide.target !== null;
    const targets = this.guide.meshes.length;
    const { byShape } = this.settings;
    const { guidance = "sds" } = guideParams(this.guide.guide, targets, this.prompt.value, byShape);
    this.settings.suit(guidance, targets);
    if (this.foreseen !== this._goal()) this._showOutlook(null);
    this.inUse.textContent = this._usesMore() ? "· in use" : "";
    this._suitLive();
    this._offerKeep();
    this._showCode();
    if (!this.shared) this.check();
  }

  /** Nothing that a job said of its own files holds for others. @param {string} asset */
  _forgetKept(asset) {
    const targets = this.guide.meshes.map(({ name, size }) => fileKey(name, size)).join();
    const [before, other] = this.keptFor.split("\n");
    if (before && before !== asset) this.settings.forget(FILE_PARAMS);
    if (this.keptFor && other !== targets) this.settings.forget(TARGET_PARAMS);
    this.keptFor = `${asset}\n${targets}`;
  }

  /** Ask what becomes of the rig, where there is one. @param {any[]} joints That the server has found. */
  _suitRig(joints) {
    this.settings.rigRow.hidden = !joints.length && !this.assets.box.viewer?.rigged;
  }

  /** Let the parts be those of the asset, as a prompt for the chosen model can name them. */
  _suitParts() {
    if (this.shared) return;
    const { asset, shown } = this.assets;
    const { model, kept } = this.settings.wish("");
    const of = asset && asset === shown && !this.guide.target ? JSON.stringify([this.assets.choices, asset.name, asset.size, model, kept.params]) : "";
    const said = Object.entries(controlParams(this._said()));
    this.parts.suit(of, said.length ? JSON.stringify(said) : "", this.prompt.value);
  }

  /** What a person said of what the asset is. */
  _said() {
    return readingOf(this.control.control);
  }

  /** A request that says nothing but what the asset is, and a prompt. @param {string} prompt @returns {import("../params.js").Wish} */
  _saidWish(prompt) {
    return { ...this.settings.wish(prompt), strength: "", control: this._said() };
  }

  /** @param {AbortSignal} signal @returns {Promise<any>} The parts of the asset. */
  async _parts(signal) {
    const asset = /** @type {Asset} */ (this.assets.asset);
    return client.parts(...(await asset.submission(documentOf(this._saidWish(""), null, this.settings.groups), {}, signal)));
  }

  /** What the form asks for, whatever the strength: a slider shows the shares of its way. */
  _key() {
    const { seed, control, ...others } = this._liveWish();
    const { of: _, ...asked } = control;
    return shapeKey(JSON.stringify([this.assets.asset?.print, others, asked]), seed);
  }

  /** Let the view show what the form asks for, as far as that takes no model. */
  _suitLive() {
    const { asset, shown } = this.assets;
    const strength = this.settings.strength.share;
    const there = asset && asset === shown && this.begun;
    const [goal, seed] = this.shared ? [this.panel?.job.id, 0] : JSON.parse(this._key());
    // The shape of the job comes with its events; one that failed is made anew.
    const state = this._isJob ? (this.panel?.state ?? "") : "";
    const waits = this._isJob && (state === "succeeded" || !isTerminal(state));
    this.live.suit({ goal: there && !this._aimless(this._wish()) ? goal : "", seed, strength, possible: !waits && this._possible() });
    if (state === "succeeded" && there && !this.live.shape) this.assets.box.say("Loading the shape…", "", "", true);
  }

  /** Whether a shape can be made before a job runs. */
  _possible() {
    return !this.shared && this.settings.byShape && this.guide.isEmpty && !this.settings.subdivide.checked;
  }

  /** What a preview is asked for. */
  _liveWish() {
    return { ...this._wish(), strength: "" };
  }

  /** @param {import("../params.js").Wish} wish @param {"glb" | "positions"} form @param {number} seed @param {AbortSignal} signal @param {boolean} [draft] Whether a draft will do. @returns {Promise<{data: ArrayBuffer, draft?: boolean}>} */
  async _asked(wish, form, seed, signal, draft = false) {
    const options = /** @type {any} */ ({ as: form, draft, signal });
    const asset = /** @type {Asset} */ (this.assets.asset);
    const document = { ...documentOf(wish, null, this.settings.groups), seeds: [seed] };
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

  // What is asked for.

  /** Show that the job cannot start yet; the button still leads to what is wrong. @param {boolean} on */
  _block(on) {
    this.form.button.classList.toggle("button-blocked", on);
  }

  _wish() {
    return { ...this.settings.wish(this.prompt.value), control: this.control.value(), guide: this.guide.value() };
  }

  /** Show what would be sent now as programs. */
  _showCode() {
    if (!this.code.open) return;
    const files = Object.entries({ asset: this.assets.asset, ...this.guide.parts }).flatMap(([part, file]) => (file ? [[part, file.name]] : []));
    fill(this.program, snippetsBlock({ document: documentOf(this._wish(), null, this.settings.groups), files: Object.fromEntries(files) }));
  }

  /** Whether nothing says yet what the asset should become. @param {import("../params.js").Wish} wish */
  _aimless(wish) {
    return !this.shared && !wish.prompt && this.guide.isEmpty;
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
    return !isEmpty(this.control.control) || this.settings.inUse;
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
      const document = documentOf(wish, this.steps, this.settings.groups);
      const found = await client.validate(...(await asset.submission(document, this.guide.parts, this.checking.signal)));
      if (turn !== this.checks || this.scope.over) return;
      this._good(found);
    } catch (error) {
      if (turn === this.checks && !this.scope.over && !isAbort(error)) this._refused(error);
    } finally {
      clearTimeout(slow);
    }
  }

  /** What an outlook depends on. */
  _goal() {
    const { asset } = this.assets;
    return JSON.stringify([this.settings.byShape, this.prompt.value, this.guide.meshes.length, asset?.name, asset?.size]);
  }

  /** Check again once the asset has been read, which the outlook needs. */
  _foresee() {
    if (this.settings.byShape && !this.foreseen) this.check();
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

  /** @param {any} found */
  _good(found) {
    this.steps = found.params.steps;
    this._showOutlook(found.outlook ?? null);
    this.prompt.refuse(null);
    fill(this.problem);
    const { triangles, vertices, meshes, joints, skipped, warnings } = found.asset;
    this._suitRig(joints);
    const more = [meshes > 1 ? `${meshes} meshes` : "", skipped.length ? `${skipped.length} left as they are` : ""].filter(Boolean);
    this.assets.describe(triangles, vertices, more, warnings);
    fill(this.estimate, estimateWords(found));
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
    this._block(true);
    this.prompt.refuse(about ? error : null);
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
    fill(this.problem, errors.length && this.control.refuse(errors) ? null : problemBox(error));
  }

  /** Return whether a job can start; what is wrong has the focus. */
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
  }

  /** Make a job of what the form asks for, and return its address. */
  async _send() {
    this.checks += 1; // an answer under way is out of date
    const asset = (this.sent = /** @type {Asset} */ (this.assets.asset));
    const wish = this._wish();
    const { parts } = this.guide;
    // A preset chosen a moment ago has other steps than the last check knew.
    const checked = await client.validate(...(await asset.submission(documentOf(wish, null, this.settings.groups), parts)));
    this.steps = checked.params.steps;
    const document = documentOf(wish, this.steps, this.settings.groups);
    const { thread } = this.begunWith;
    if (asset === this.begunWith.asset && thread) document.metadata = { thread };
    const job = this.start !== null && this.panel ? await client.branch(this.panel.job, this.start, /** @type {any} */ (document)) : await client.submit(...(await asset.submission(document, parts)));
    return routeHash({ name: "job", id: job.id });
  }
}
