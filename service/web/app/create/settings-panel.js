// @ts-check
/** How the job is made: everything but its asset and its words. What is here stands under Details. */
import { button, chip, fill, h, labelled, options } from "../dom.js";
import { markField } from "./field-rows.js";
import { groupsOf, isUnused } from "../groups.js";
import { integerProblem, keptText, MAX_SEED, nothingKept, PRESETS, randomSeed, USUAL_PRESET } from "../params.js";
import { EXEMPLAR } from "./guide/model.js";
import { ShareSlider } from "./share-slider.js";

/** How the asset becomes what is asked for. @type {[string, string][]} */
const WAYS = [["shape", "By shape: fitted, part to part"], ["pictures", "By pictures: a model looks at it, and pushes it little by little"]];
/** What becomes of joints, morph targets and clips. @type {[string, string][]} */
const RIGS = [["follow", "Follows the shape"], ["keep", "Stays as it is, to share clips with other characters"]];

export class SettingsPanel {
  /** @param {() => void} onChange @param {(model: import("../vocabulary.js").Model | null) => void} onModel Another model, or another way. */
  constructor(onChange, onModel) {
    this.onChange = onChange;
    this.onModel = onModel;
    /** @type {import("../vocabulary.js").Catalogue} */
    this.catalogue = { default: "", models: [], shapes: null };
    /** In which a request has its parameters. */
    this.groups = groupsOf(null);
    this.way = choice("way", WAYS, () => this._modelChanged());
    this.wayRow = labelled("way", "How", this.way);
    this.wayRow.hidden = true;
    this.model = choice("model", [], () => this._modelChanged());
    this.modelRow = labelled("model", "Model", this.model);
    this.preset = choice("preset", PRESETS.map(([value, label, text]) => [value, `${label}: ${text.toLowerCase()}`]), onChange);
    this.preset.value = USUAL_PRESET;
    this.presetRow = labelled("preset", "Quality", this.preset);
    this.strength = new ShareSlider("strength", onChange);
    const problem = h("p", { class: "field-problem", id: "seed-problem", hidden: true, "aria-live": "polite" });
    // Not of the type "number": a browser hides what it does not take for one.
    const input = h("input", { id: "seed", type: "text", inputmode: "numeric", autocomplete: "off", "aria-describedby": problem.id, on: { input: onChange } });
    this.seed = { input, problem };
    this.seed.input.value = String(randomSeed());
    this.rig = choice("rig", RIGS, onChange);
    /** What the server does with a rig where nobody chooses. */
    this.usualRig = RIGS[0][0];
    this.rigRow = labelled("rig", "Rig", this.rig);
    this.rigRow.hidden = true;
    this.subdivide = h("input", { id: "subdivide", type: "checkbox", on: { change: onChange } });
    this.kept = nothingKept();
    this.keptText = h("p", null);
    const drop = chip("Drop them", () => this._drop());
    this.keptRow = h("div", { class: "kept small", hidden: true }, this.keptText, drop);
    this.element = this._build();
  }

  _build() {
    const random = button("Random variation", () => {
      this.seed.input.value = String(randomSeed());
      this.onChange();
    }, { icon: "dice", quiet: true });
    const seed = labelled("seed", "Variation", h("div", { class: "joined" }, this.seed.input, random), this.seed.problem);
    const split = h("label", { class: "check", for: "subdivide" }, this.subdivide, h("span", null, "Split long edges first, so that large triangles can bend; the result has more triangles"));
    return h("div", { class: "settings" }, this.wayRow, this.modelRow, this.presetRow, this.rigRow, seed, split, this.keptRow);
  }

  /** Return whether all that was typed can be sent; what cannot is said beside it. */
  check() {
    const problem = integerProblem(this.seed.input.value, 0, MAX_SEED);
    markField(this.seed, problem);
    return !problem;
  }

  /** @param {any} schema The JSON schema of a job's parameters; null: it is not known. */
  learn(schema) {
    this.groups = groupsOf(schema);
    this.wayRow.hidden = !(EXEMPLAR in this.groups.guidance);
    this.strength.offer(this.groups.guidance[EXEMPLAR]?.strength?.default);
    this.usualRig = schema?.["x-output"]?.rig ?? this.usualRig;
    this.rig.value = this.usualRig;
  }

  /** Whether the asset is fitted to a shape, in place of pushed by a model that looks at pictures of it. */
  get byShape() {
    return !this.wayRow.hidden && this.way.value === "shape";
  }

  /** Show those that a kind of guidance has. @param {string} kind @param {number} targets How many meshes there are to become. */
  suit(kind, targets) {
    this.presetRow.hidden = isUnused("preset", kind, this.groups);
    this.modelRow.hidden = isUnused("model", kind, this.groups) || this.catalogue.models.length < 2; // with one there is nothing to choose
    // Of several meshes, the nearest is fitted to.
    this.way.options[1].disabled = targets > 1;
    if (targets > 1) this.way.value = "shape";
  }

  /** @param {import("../vocabulary.js").Catalogue} catalogue */
  offer(catalogue) {
    this.catalogue = catalogue;
    fill(this.model, catalogue.models.map(({ id, title, available }) => h("option", { value: id, disabled: !available }, available ? title : `${title} (not installed)`)));
    this.model.value = catalogue.default;
    this._modelChanged();
  }

  /** The model that is chosen. */
  get chosen() {
    return this.catalogue.models.find((found) => found.id === this.model.value) ?? null;
  }

  /** Whether the server fits to shapes where nobody chooses: unless its operator has named a model. */
  get usuallyByShape() {
    return this.catalogue.default === "builtin";
  }

  _modelChanged() {
    this.onModel(this.chosen);
    this.onChange();
  }

  /** @param {import("../params.js").Kept} kept */
  _keep(kept) {
    this.kept = kept;
    const text = keptText(kept);
    this.keptRow.hidden = !text;
    this.keptText.textContent = text && `Also kept from that job: ${text}.`;
  }

  _drop() {
    this._keep(nothingKept());
    this.onChange();
  }

  /** Keep no parameters that were for another file. @param {string[]} names */
  forget(names) {
    this._keep({ ...this.kept, params: Object.fromEntries(Object.entries(this.kept.params).filter(([name]) => !names.includes(name))) });
  }

  /** @param {string} prompt @returns {import("../params.js").Wish} */
  wish(prompt) {
    return {
      prompt,
      model: this.model.value,
      preset: this.preset.value,
      seed: Number(this.seed.input.value),
      subdivide: this.subdivide.checked,
      rig: this.rig.value === this.usualRig ? "" : this.rig.value,
      byShape: this.byShape,
      strength: this.strength.value,
      kept: this.kept,
    };
  }

  /** Whether anything is set that does not show elsewhere. */
  get inUse() {
    return this.subdivide.checked || !this.keptRow.hidden;
  }

  /** Set everything as at the beginning. */
  reset() {
    this.restore({ model: this.catalogue.default, byShape: this.usuallyByShape });
  }

  /** @param {Partial<Omit<import("../params.js").Wish, "seed"> & {seed: number | string}>} wish What it lacks is as at the beginning. */
  restore({ model, preset = USUAL_PRESET, seed = randomSeed(), subdivide = false, rig = "", strength = "", kept = nothingKept(), byShape = false }) {
    // A model that this server no longer runs gives way to its default.
    if (this.catalogue.models.some((found) => found.id === model && found.available)) this.model.value = String(model);
    this.way.value = byShape ? "shape" : "pictures";
    this._modelChanged();
    this.preset.value = preset;
    this.seed.input.value = String(seed);
    this.subdivide.checked = subdivide;
    this.rig.value = rig || this.usualRig;
    this._keep(kept);
    this.strength.set(strength);
  }
}

/** @param {string} id @param {[string, string][]} pairs Values, and words. @param {() => void} onChange */
function choice(id, pairs, onChange) {
  return h("select", { id, on: { change: onChange } }, options(pairs));
}
