// @ts-check
/**
 * The workbench: the asset as large as the window allows, words beside it, and at once the shape that they stand for. The
 * page of a job is the same workbench, with that job's state.
 */
import { append, fill, h } from "../dom.js";
import { keepDraft } from "../drafts.js";
import { exampleSection } from "../examples/gallery.js";
import { isTerminal } from "../history.js";
import { recentJobs } from "../jobs/card.js";
import { JobPanel } from "../job/panel.js";
import { currentLink, restUntilUsed } from "../key.js";
import { fileKey } from "../params.js";
import { snippetsBlock } from "../snippets.js";
import { movingTools } from "../viewer-box.js";
import { AssetPanel } from "./asset-panel.js";
import { Beginning } from "./beginning.js";
import { Check } from "./check.js";
import { Comparison } from "./comparison.js";
import { controlParams, isEmpty } from "./control/model.js";
import { ControlPanel } from "./control/panel.js";
import { Downloads } from "./downloads.js";
import { JobForm, kindsNav } from "./form.js";
import { guideParams } from "./guide/model.js";
import { GuidePanel } from "./guide/panel.js";
import { Live } from "./live.js";
import { PartsPanel } from "./parts/panel.js";
import { PromptField } from "./prompt-field.js";
import { Requests } from "./requests.js";
import { SettingsPanel } from "./settings-panel.js";
import { ShapeStrip } from "./shape-strip.js";
import { ShownJob } from "./shown-job.js";

/** @typedef {import("./live.js").Shape} Shape */

export class Workbench {
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
    /** Whether who looks came by a link, and makes nothing. */
    this.shared = currentLink() !== "";
    const changed = () => this.changed();
    // The asset, and what the view shows of it.
    this.assets = new AssetPanel(scope, changed, job === null);
    this.control = new ControlPanel(this.assets.box, changed);
    this.live = this._live();
    this.comparison = new Comparison(this.assets, scope);
    this.strip = new ShapeStrip(scope, (shape) => this._take(shape), () => this.comparison.choices(this.strip.shapes));
    // What it should become.
    this.prompt = new PromptField(changed);
    this.parts = this._parts();
    this.guide = new GuidePanel(this.assets, scope, changed);
    this.settings = new SettingsPanel(changed, (model) => this._offer(model));
    this.requests = new Requests(this);
    this.check = new Check(this);
    this.form = new JobForm(scope, "New job", "Keep", { ready: () => this.check.ready(), send: () => this.requests.send(), refuse: (error) => this.check.refuseJob(error) });
    // What there is of it already.
    this.beginning = new Beginning(this, job ? job.id : from);
    this.shown = new ShownJob(this);
    this.panel = job ? new JobPanel(job, scope, { offer: (...shapes) => this.shown.offer(...shapes), finished: (_, artifacts) => this.shown.finished(artifacts) }) : null;
    this.downloads = new Downloads(scope, (signal) => this.requests.exact(signal), () => this._named());
    this.program = h("div", null);
    /** The request as code to copy. */
    this.code = h("details", { class: "advanced", on: { toggle: () => this._showCode() } }, h("summary", null, "As code"), this.program);
    this.inUse = h("span", { class: "small muted" });
    this.more = h("details", { class: "advanced bench-details", on: { toggle: () => this.control.showBrush() } }, h("summary", null, "Details ", this.inUse));
    this._assemble();
    this._build(root);
    if (job) this.shown.attach(job, against);
    else restUntilUsed(root, scope, () => {
      this.parts.of = ""; // it was not read
      void this.beginning.begin(from);
    });
    this.beginning.begin(job ? job.id : from);
  }

  _live() {
    return new Live(this.assets.box, this.scope, {
      ask: (form, seed, signal, draft) => this.requests.preview(this.requests.shapeWish(), form, seed, signal, draft),
      take: (seed) => {
        this.settings.seed.input.value = String(seed);
        this.changed();
      },
      reshaped: () => this.parts.reshaped(this.live.shape !== null),
      shown: (shape) => this._shown(shape),
      label: () => this.prompt.value || "Target",
    });
  }

  _parts() {
    const parts = new PartsPanel(this.assets.box, this.control, this.scope, {
      ask: (signal) => this.requests.parts(signal),
      change: async (prompt, form, signal) => (await this.requests.preview(this.requests.saidWish(prompt), form, this.requests.wish().seed, signal)).data,
      write: (prompt) => this.prompt.set(prompt),
    });
    parts.onRead = () => this.check.foresee();
    return parts;
  }

  /** What stands below the view, and what is done once an asset is in it. */
  _assemble() {
    const { assets, comparison, scope } = this;
    assets.guide = (files) => this.guide.take(files);
    assets.addBelow(this.control.toolbar);
    assets.addBelow(comparison.element);
    assets.addBelow(movingTools(scope, [comparison.box, assets.box], (ending) => `turntable.${ending}`));
    assets.onShown = () => {
      this.strip.begin(assets.asset?.print ?? "");
      this._suitParts();
      this.suitLive();
      this.suitRig([]);
      this.offerKeep();
    };
  }

  /** @param {HTMLElement} root */
  _build(root) {
    const { panel, shared, settings, comparison, check, form } = this;
    const making = shared ? [] : [settings.element, this.control.element, this.code];
    append(this.more, [panel?.results, comparison.view, making, panel?.settings]);
    const words = [this.beginning.restored, this.prompt.element, check.outlook, check.problem, this.parts.element, this.guide.element, this.live.lacks, this.live.element];
    form.element.append(
      ...(panel ? [panel.head, panel.top] : [h("h1", null, "Describe what it ", h("em", null, "should become"))]),
      ...(shared ? [] : words),
      settings.strength.element,
      this.strip.element,
      h("div", { class: "start-bar" }, shared ? null : [form.estimate, this.shown.starts], h("div", { class: "row" }, this.downloads.element, shared ? null : form.button)),
      this.more,
    );
    const around = panel ? [] : [kindsNav("create"), recentJobs(this.scope), exampleSection(this.scope)];
    fill(root, h("div", { class: "bench" }, this.assets.element, form.element), around);
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

  /** @param {import("../params.js").Wish} wish @param {Record<string, import("../assets.js").Asset>} files Besides the asset, by their names in a job. */
  restore(wish, files) {
    this.settings.restore(wish);
    this.control.restore(wish.control);
    this.guide.restore(wish.guide, files);
    this.prompt.set(wish.prompt);
  }

  /** Something in the form is another one. */
  changed() {
    const { beginning, settings, guide, control } = this;
    const { asset } = this.assets;
    const key = asset ? fileKey(asset.name, asset.size) : "";
    beginning.forgetKept(key);
    if (key) control.assetIs(key);
    this._suitParts();
    control.view.exclude(settings.kept.params.exclude ?? []);
    if (beginning.over && !this.panel) keepDraft({ from: beginning.from, wish: { ...this.requests.wish(), prompt: this.prompt.input.value }, asset, files: guide.files });
    this.prompt.element.hidden = guide.target !== null;
    const targets = guide.meshes.length;
    const { guidance = "sds" } = guideParams(guide.guide, targets, this.prompt.value, settings.byShape);
    settings.suit(guidance, targets);
    // Whether the fold holds anything that the job will have.
    this.inUse.textContent = !isEmpty(control.control) || settings.inUse ? "· in use" : "";
    this.suitLive();
    this.offerKeep();
    this._showCode();
    if (!this.shared) this.check.changed();
  }

  /** Ask what becomes of the rig, where there is one. @param {any[]} joints That the server has found. */
  suitRig(joints) {
    this.settings.rigRow.hidden = !joints.length && !this.assets.box.viewer?.rigged;
  }

  /** Let the parts be those of the asset, as a prompt for the chosen model can name them. */
  _suitParts() {
    if (this.shared) return;
    const { asset, shown } = this.assets;
    const { model, kept } = this.settings.wish("");
    const of = asset && asset === shown && !this.guide.target ? JSON.stringify([this.assets.choices, asset.name, asset.size, model, kept.params]) : "";
    const said = Object.entries(controlParams(this.requests.said()));
    this.parts.suit(of, said.length ? JSON.stringify(said) : "", this.prompt.value);
  }

  /** Let the view show what the form asks for, as far as that takes no model. */
  suitLive() {
    const { requests, panel, live } = this;
    const { asset, shown } = this.assets;
    const strength = this.settings.strength.share;
    const there = asset && asset === shown && this.beginning.over;
    const [goal, seed] = this.shared ? [panel?.job.id, 0] : JSON.parse(requests.key);
    // The shape of the job comes with its events; one that failed is made anew.
    const state = this.shown.isAsked ? (panel?.state ?? "") : "";
    const waits = this.shown.isAsked && (state === "succeeded" || !isTerminal(state));
    live.suit({ goal: there && !requests.isAimless ? goal : "", seed, strength, possible: !waits && requests.isPossible });
    if (state === "succeeded" && there && !live.shape) this.assets.box.say("Loading the shape…", "", "", true);
  }

  /** @param {Shape | null} shape */
  _shown(shape) {
    if (shape && shape.key === this.live.key) shape.wish ??= this.requests.wish();
    this.strip.show(shape);
    this.comparison.offer(shape !== null);
    this.settings.strength.element.hidden = shape === null || !this.live.morphs;
    this.offerKeep();
  }

  /** Go back to a shape. @param {Shape} shape */
  async _take(shape) {
    if (shape.href) return void (location.hash = shape.href);
    this.shown.startFrom(shape.stored?.step ?? null);
    if (!shape.wish || shape.key === this.live.key) return this.live.look(shape);
    this.live.know(shape);
    this.restore(shape.wish, this.guide.files);
    this.changed();
  }

  /** Offer what can be done with what is shown. */
  offerKeep() {
    const { panel, settings, live, form } = this;
    const { isAsked } = this.shown;
    const state = panel?.state ?? "";
    const running = panel !== null && !isTerminal(state || panel.job.state);
    const done = isAsked && state === "succeeded";
    settings.strength.exaggerate(done && live.morphs);
    const { share } = live;
    // A job has the strength of a fit; any other result is only shown weaker.
    const same = this.shared || (isAsked && running) || (done && (!settings.byShape || share >= 1));
    form.button.hidden = this.form.estimate.hidden = same;
    form.rename(this.shown.start !== null || !this.requests.isPossible || !live.able ? "Run" : "Keep");
    // Where nothing can be drawn, the result is there all the same.
    const shape = live.shape ?? (done && this.assets.flat ? (this.strip.stored.at(-1) ?? null) : null);
    this.downloads.show(shape && { shape, share: live.morphs ? share : 1, job: panel?.job ?? null, result: done && shape.key === this.shown.key });
  }

  /** What names the files of a shape that no job has, as a job does. */
  _named() {
    return { asset: { filename: this.assets.asset?.name ?? "" }, prompt: this.prompt.value, params: { seed: this.requests.wish().seed } };
  }

  /** Show what would be sent now as programs. */
  _showCode() {
    if (!this.code.open) return;
    const files = Object.entries({ asset: this.assets.asset, ...this.guide.files }).flatMap(([name, file]) => (file ? [[name, file.name]] : []));
    fill(this.program, snippetsBlock({ document: this.requests.document(), files: Object.fromEntries(files) }));
  }
}
