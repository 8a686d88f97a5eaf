// @ts-check
/** How the job is made: everything but its asset and its words. What is here stands under Details. */
import { button, fill, h, labelled } from "../dom.js";
import { FieldRows, markField } from "./field-rows.js";
import { figure } from "../format.js";
import { isUnused } from "../groups.js";
import { formOf, integerProblem, keptText, MAX_SEED, nothingKept, PRESETS, randomSeed, USUAL_PRESET } from "../params.js";
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
    this.way = choice("way", WAYS, () => this._modelChanged());
    this.wayRow = labelled("way", "How", this.way);
    this.wayRow.hidden = true;
    this.model = choice("model", [], () => this._modelChanged());
    this.modelRow = labelled("model", "Model", this.model);
    this.preset = choice("preset", PRESETS.map(([value, label, text]) => [value, `${label}: ${text.toLowerCase()}`]), onChange);
    this.preset.value = USUAL_PRESET;
    this.presetRow = labelled("preset", "Quality", this.preset);
    this.strength = new ShareSlider("strength", onChange);
    this.seed = integerField("seed", 0, MAX_SEED, onChange);
    this.seed.input.value = String(randomSeed());
    this.rig = choice("rig", RIGS, onChange);
    /** What the server does with a rig where nobody chooses. */
    this.usualRig = RIGS[0][0];
    this.rigRow = labelled("rig", "Rig", this.rig);
    this.rigRow.hidden = true;
    this.subdivide = h("input", { id: "subdivide", type: "checkbox", on: { change: onChange } });
    /** @type {import("../params.js").Form} */
    this.offered = formOf(null);
    this.fields = new FieldRows(onChange);
    this.kept = nothingKept();
    this.keptText = h("p", null);
    const drop = h("button", { type: "button", class: "chip chip-small", on: { click: () => this._drop() } }, "Drop them");
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
    this.fields.advanced.append(split);
    return h("div", { class: "settings" }, this.wayRow, this.modelRow, this.presetRow, this.rigRow, seed, this.keptRow, this.fields.advanced);
  }

  /** Return whether all that was typed can be sent; what cannot is said beside it. */
  check() {
    const good = this.fields.settle();
    markField(this.seed, this.seed.check());
    return good && !this.seed.check();
  }

  /** Say what the server refused beside it. @param {any[]} errors @returns {boolean} whether each of them has found its place */
  refuse(errors) {
    return this.fields.refuse(errors);
  }

  /** What the preset would choose. @param {Record<string, any>} params */
  resolved(params) {
    for (const [name, field] of this.fields.rows) {
      const value = params[name];
      if (field.input.value !== "" || value === undefined || value === null) continue;
      if (field.input instanceof HTMLInputElement) field.input.placeholder = typeof value === "number" ? figure(value) : String(value) || "none";
      else field.input.options[0].text = `As the quality says: ${[...field.input.options].find((option) => option.value === value)?.text ?? value}`;
    }
  }

  /** @param {import("../params.js").Form} form */
  offerFields(form) {
    this.offered = form;
    this.wayRow.hidden = !(EXEMPLAR in form.groups.guidance);
    this.strength.offer(form.fields);
    const others = form.fields.filter(({ name }) => name !== this.strength.name);
    fill(this.fields.more, others.map((field) => this.fields.add(field, ["As the quality says", "automatic"])));
  }

  /** @param {string | undefined} usual What the server does with a rig where nobody chooses. */
  offerRig(usual) {
    this.usualRig = usual ?? this.usualRig;
    this.rig.value = this.usualRig;
  }

  /** Whether the asset is fitted to a shape, in place of pushed by a model that looks at pictures of it. */
  get byShape() {
    return !this.wayRow.hidden && this.way.value === "shape";
  }

  /** Show those that a kind of guidance has. @param {string} kind @param {number} targets How many meshes there are to become. */
  suit(kind, targets) {
    const unused = (/** @type {string} */ name) => isUnused(name, kind, this.offered.groups);
    for (const [name, { row }] of this.fields.rows) row.hidden = unused(name);
    this.presetRow.hidden = unused("preset");
    this.modelRow.hidden = unused("model") || this.catalogue.models.length < 2; // with one there is nothing to choose
    // Of several meshes, the nearest is fitted to.
    this.way.options[1].disabled = targets > 1;
    if (targets > 1) this.way.value = "shape";
  }

  /** @param {import("../vocabulary.js").Catalogue} catalogue */
  offer(catalogue) {
    this.catalogue = catalogue;
    const options = catalogue.models.map((model) =>
      h("option", { value: model.id, disabled: !model.available }, model.available ? model.title : `${model.title} (not installed)`),
    );
    fill(this.model, options);
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
      advanced: { ...Object.fromEntries([...this.fields.rows].map(([name, field]) => [name, field.input.value])), [this.strength.name]: this.strength.value },
      kept: this.kept,
    };
  }

  /** Whether a parameter can be set, as the form is now. @param {string} name */
  offers(name) {
    return this.fields.rows.get(name)?.row.hidden === false;
  }

  /** What was typed for a parameter; empty where the quality decides. @param {string} name */
  value(name) {
    return this.fields.rows.get(name)?.input.value ?? "";
  }

  /** @param {string} name @param {string} value */
  setValue(name, value) {
    const input = this.fields.rows.get(name)?.input;
    if (!input) return;
    input.value = value;
    // A value that is not among the choices, such as an angle.
    if (input.value !== value && input instanceof HTMLSelectElement) {
      input.append(h("option", { value }, value));
      input.value = value;
    }
  }

  /** Whether anything is set that does not show elsewhere. */
  get inUse() {
    return this.subdivide.checked || [...this.fields.rows.values()].some(({ input, row }) => !row.hidden && input.value !== "");
  }

  /** Set everything as at the beginning. */
  reset() {
    this.restore({ model: this.catalogue.default, byShape: this.usuallyByShape });
  }

  /** @param {Partial<Omit<import("../params.js").Wish, "seed"> & {seed: number | string}>} wish What it lacks is as at the beginning. */
  restore({ model, preset = USUAL_PRESET, seed = randomSeed(), subdivide = false, rig = "", advanced = {}, kept = nothingKept(), byShape = false }) {
    // A model that this server no longer runs gives way to its default.
    if (this.catalogue.models.some((found) => found.id === model && found.available)) this.model.value = String(model);
    this.way.value = byShape ? "shape" : "pictures";
    this._modelChanged();
    this.preset.value = preset;
    this.seed.input.value = String(seed);
    this.subdivide.checked = subdivide;
    this.rig.value = rig || this.usualRig;
    this._keep(kept);
    for (const name of this.fields.rows.keys()) this.setValue(name, advanced[name] ?? "");
    this.strength.set(advanced[this.strength.name] ?? "");
    this.fields.advanced.open = [...this.fields.rows.values()].some(({ input }) => input.value !== "");
  }
}

/** @param {string} id @param {[string, string][]} options @param {() => void} onChange */
function choice(id, options, onChange) {
  return h("select", { id, on: { change: onChange } }, options.map(([value, text]) => h("option", { value }, text)));
}

/** A field for a whole number, and what is wrong with what is in it. @param {string} id @param {number} min @param {number} max @param {() => void} onChange */
function integerField(id, min, max, onChange) {
  const problem = h("p", { class: "field-problem", id: `${id}-problem`, hidden: true, "aria-live": "polite" });
  // Not of the type "number": a browser hides what it does not take for one.
  const input = h("input", { id, type: "text", inputmode: "numeric", autocomplete: "off", "aria-describedby": problem.id, on: { input: onChange } });
  return { input, problem, check: () => integerProblem(input.value, min, max) };
}
