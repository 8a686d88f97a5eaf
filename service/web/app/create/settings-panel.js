// @ts-check
/** The settings of a new job: everything but its asset and its prompt. */
import { button, fill, h, labelled } from "../dom.js";
import { FieldRows, markField } from "./field-rows.js";
import { figure } from "../format.js";
import { isUnused } from "../groups.js";
import { formOf, integerProblem, keptText, MAX_SEED, MAX_VARIATIONS, nothingKept, PRESETS, randomSeed } from "../params.js";
import { EXEMPLAR } from "./guide/model.js";
import { radioCards } from "./radio-cards.js";
import { ShareSlider } from "./share-slider.js";

/** What becomes of joints, morph targets and clips. @type {[string, string, string][]} */
const RIGS = [
  ["follow", "Follows the shape", "The result moves as the asset does"],
  ["keep", "Stays as it is", "To share clips with other characters"],
];

export class SettingsPanel {
  /** @param {() => void} onChange @param {(model: import("../vocabulary.js").Model | null) => void} onModel */
  constructor(onChange, onModel) {
    this.onChange = onChange;
    this.onModel = onModel;
    /** @type {import("../vocabulary.js").Catalogue} */
    this.catalogue = { default: "", models: [], shapes: null };
    this.model = h("select", { id: "model", on: { change: () => this._modelChanged() } });
    this.modelRow = labelled("model", "Model", this.model);
    this.modelRow.hidden = true;
    this.preset = radioCards("preset", PRESETS, "preview", onChange);
    this.presetRow = h("fieldset", { class: "field" }, h("legend", { class: "field-label" }, "Quality"), this.preset.element);
    this.strength = new ShareSlider("strength", onChange);
    this.seed = integerField("seed", 0, MAX_SEED, onChange);
    this.seed.input.value = String(randomSeed());
    this.variations = integerField("variations", 1, MAX_VARIATIONS, onChange);
    this.variations.input.value = "1";
    this.rig = radioCards("rig", RIGS, RIGS[0][0], onChange);
    /** What the server does with a rig where nobody chooses. */
    this.usualRig = RIGS[0][0];
    this.rigRow = h("fieldset", { class: "field", hidden: true }, h("legend", { class: "field-label" }, "Rig"), this.rig.element);
    this.subdivide = h("input", { id: "subdivide", type: "checkbox", on: { change: onChange } });
    /** @type {import("../params.js").Form} */
    this.offered = formOf(null);
    this.fields = new FieldRows(onChange);
    this.kept = nothingKept();
    this.keptText = h("p", null);
    const drop = h("button", { type: "button", class: "chip chip-small", on: { click: () => this._drop() } }, "Drop them");
    this.keptRow = h("div", { class: "kept small", hidden: true }, this.keptText, drop);
    this.element = h("div", { class: "settings" }, this.modelRow, this.presetRow, this.strength.element, this.rigRow, this.keptRow);
    /** The less usual settings, for the fold of the form. */
    this.further = this._further();
  }

  _further() {
    this.fields.advanced.append(
      h("label", { class: "check", for: "subdivide" }, this.subdivide, h("span", null, "Split long edges first, so that large triangles can bend; the result has more triangles")),
    );
    const random = button("Random variation", () => {
      this.seed.input.value = String(randomSeed());
      this.onChange();
    }, { icon: "dice", quiet: true });
    return h(
      "div",
      { class: "settings" },
      h(
        "div",
        { class: "pair" },
        labelled("seed", "Variation", h("div", { class: "joined" }, this.seed.input, random), this.seed.problem),
        labelled("variations", "How many", this.variations.input, this.variations.problem),
      ),
      this.fields.advanced,
    );
  }

  /** Return whether all that was typed can be sent; what cannot is said beside it. */
  check() {
    const good = this.fields.settle();
    for (const field of [this.seed, this.variations]) markField(field, field.check());
    return good && !this.seed.check() && !this.variations.check();
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
    this.strength.offer(form.fields);
    const others = form.fields.filter(({ name }) => name !== this.strength.name);
    fill(this.fields.more, others.map((field) => this.fields.add(field, ["As the quality says", "automatic"])));
  }

  /** @param {string | undefined} usual What the server does with a rig where nobody chooses. */
  offerRig(usual) {
    this.usualRig = usual ?? this.usualRig;
    this.rig.set(this.usualRig);
  }

  /** Show those that a kind of guidance has. @param {string} kind */
  suit(kind) {
    const unused = (/** @type {string} */ name) => isUnused(name, kind, this.offered.groups);
    for (const [name, { row }] of this.fields.rows) row.hidden = unused(name);
    this.presetRow.hidden = unused("preset");
    this.strength.element.hidden = kind !== EXEMPLAR;
    this.modelRow.hidden = unused("model") || !this._choosesModel;
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

  /** The server runs no others: with one there is nothing to choose. */
  get _choosesModel() {
    return this.catalogue.models.length > 1;
  }

  /** The model that is chosen. */
  get chosen() {
    return this.catalogue.models.find((found) => found.id === this.model.value) ?? null;
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

  get variationCount() {
    return Math.min(MAX_VARIATIONS, Math.max(1, Math.round(Number(this.variations.input.value)) || 1));
  }

  /** @param {string} prompt @returns {import("../params.js").Wish} */
  wish(prompt) {
    return {
      prompt,
      model: this.model.value,
      preset: this.preset.value(),
      seed: Number(this.seed.input.value),
      variations: this.variationCount,
      subdivide: this.subdivide.checked,
      rig: this.rig.value() === this.usualRig ? "" : this.rig.value(),
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

  /** Whether any of the less usual settings is another than at the beginning. */
  get furtherInUse() {
    return this.variationCount > 1 || this.subdivide.checked || [...this.fields.rows.values()].some(({ input, row }) => !row.hidden && input.value !== "");
  }

  /** Set everything as at the beginning. */
  reset() {
    this.restore({ model: this.catalogue.default });
  }

  /** The settings as they were typed, right or wrong, for `restore`. @param {string} prompt */
  draft(prompt) {
    return { ...this.wish(prompt), seed: this.seed.input.value, variations: this.variations.input.value };
  }

  /** @param {Partial<Omit<import("../params.js").Wish, "seed" | "variations"> & {seed: number | string, variations: number | string}>} wish What it lacks is as at the beginning. */
  restore({ model, preset = PRESETS[0][0], seed = randomSeed(), variations = 1, subdivide = false, rig = "", advanced = {}, kept = nothingKept() }) {
    // A model that this server no longer runs gives way to its default.
    if (this.catalogue.models.some((found) => found.id === model && found.available)) this.model.value = String(model);
    this._modelChanged();
    this.preset.set(preset);
    this.seed.input.value = String(seed);
    this.variations.input.value = String(variations);
    this.subdivide.checked = subdivide;
    this.rig.set(rig || this.usualRig);
    this._keep(kept);
    for (const name of this.fields.rows.keys()) this.setValue(name, advanced[name] ?? "");
    this.strength.set(advanced[this.strength.name] ?? "");
    this.fields.advanced.open = [...this.fields.rows.values()].some(({ input }) => input.value !== "");
  }
}

/** A field for a whole number, and what is wrong with what is in it. @param {string} id @param {number} min @param {number} max @param {() => void} onChange */
function integerField(id, min, max, onChange) {
  const problem = h("p", { class: "field-problem", id: `${id}-problem`, hidden: true, "aria-live": "polite" });
  // Not of the type "number": a browser hides what it does not take for one.
  const input = h("input", { id, type: "text", inputmode: "numeric", autocomplete: "off", "aria-describedby": problem.id, on: { input: onChange } });
  return { input, problem, check: () => integerProblem(input.value, min, max) };
}
