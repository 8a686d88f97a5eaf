// @ts-check
/** Everything about a new job but its asset and its prompt. */
import { button, fill, h, uniqueId } from "../dom.js";
import { figure } from "../format.js";
import { fieldProblem, keptText, MAX_SEED, MAX_VARIATIONS, nothingKept, PRESETS, randomSeed } from "../params.js";

const OTHER = "\u0000other";

export class SettingsPanel {
  /**
   * @param {() => void} onChange
   * @param {(model: import("../vocabulary.js").Model | null) => void} onModel
   */
  constructor(onChange, onModel) {
    this.onChange = onChange;
    this.onModel = onModel;
    /** @type {import("../vocabulary.js").Catalogue} */
    this.catalogue = { default: "", models: [] };
    this.model = h("select", { id: "prior", on: { change: () => this._modelChanged() } });
    this.otherModel = h("input", {
      id: "other-prior", type: "text", maxlength: 500, spellcheck: "false", autocapitalize: "none",
      placeholder: "hub id, or a folder on the worker", on: { input: onChange },
    });
    this.otherRow = h("div", { class: "field", hidden: true }, h("label", { class: "field-label", for: "other-prior" }, "Model id or folder"), this.otherModel);
    this.modelRow = h("div", { class: "field" }, h("label", { class: "field-label", for: "prior" }, "Prior"), this.model);
    this.preset = radios("preset", PRESETS, "preview", onChange);
    this.seed = h("input", { id: "seed", type: "number", min: 0, max: MAX_SEED, step: 1, inputmode: "numeric", on: { input: onChange } });
    this.seed.value = String(randomSeed());
    this.variations = h("input", { id: "variations", type: "number", min: 1, max: MAX_VARIATIONS, step: 1, inputmode: "numeric", on: { input: onChange } });
    this.variations.value = "1";
    this.morph = h("input", { id: "morph", type: "checkbox", on: { change: onChange } });
    /** @type {Map<string, {input: HTMLInputElement | HTMLSelectElement, problem: HTMLElement, row: HTMLElement}>} */
    this.fields = new Map();
    /** @type {import("../params.js").Field[]} */
    this.offered = [];
    this.advancedGrid = h("div", { class: "advanced-grid" });
    this.advanced = h("details", { class: "advanced" }, h("summary", null, "Advanced"));
    this.kept = nothingKept();
    this.keptText = h("p", null);
    const drop = h("button", { type: "button", class: "chip chip-small", on: { click: () => this._drop() } }, "Drop them");
    this.keptRow = h("div", { class: "kept small", hidden: true }, this.keptText, drop);
    this.element = this._build();
  }

  _build() {
    const morph = h("label", { class: "check", for: "morph" }, this.morph, h("span", null, "Also write ", h("code", null, "morph.glb"), ", with an animation from before to after"));
    this.advanced.append(this.advancedGrid, morph);
    const random = button("Random seed", () => {
      this.seed.value = String(randomSeed());
      this.onChange();
    }, { icon: "dice", quiet: true });
    return h(
      "div",
      { class: "settings" },
      this.modelRow,
      this.otherRow,
      h("fieldset", { class: "field" }, h("legend", { class: "field-label" }, "Preset"), this.preset.element),
      h(
        "div",
        { class: "pair" },
        h("div", { class: "field" }, h("label", { class: "field-label", for: "seed" }, "Seed"), h("div", { class: "joined" }, this.seed, random)),
        h("div", { class: "field" }, h("label", { class: "field-label", for: "variations" }, "Variations"), this._stepper()),
      ),
      this.keptRow,
      this.advanced,
    );
  }

  _stepper() {
    const by = (/** @type {number} */ change) => () => {
      this.variations.value = String(Math.min(MAX_VARIATIONS, Math.max(1, this.variationCount + change)));
      this.onChange();
    };
    return h(
      "div",
      { class: "joined stepper" },
      h("button", { type: "button", class: "button", "aria-label": "Fewer variations", on: { click: by(-1) } }, "−"),
      this.variations,
      h("button", { type: "button", class: "button", "aria-label": "More variations", on: { click: by(1) } }, "+"),
    );
  }

  /** @param {import("../params.js").Field} field */
  _field(field) {
    const id = `param-${field.name}`;
    const problem = h("p", { class: "field-problem", id: `${id}-problem`, hidden: true, "aria-live": "polite" });
    const common = { id, "aria-describedby": `${id}-help ${id}-problem` };
    const input =
      field.type === "choice"
        ? h("select", common, h("option", { value: "" }, "As the preset"), (field.choices ?? []).map(([value, label]) => h("option", { value }, label)))
        : h("input", { ...common, type: "text", inputmode: field.type === "text" ? null : "decimal", placeholder: "preset", autocomplete: "off" });
    input.addEventListener("input", () => {
      this._check(field);
      this.onChange();
    });
    const row = h(
      "div",
      { class: "field" },
      h("label", { class: "field-label", for: id }, field.label),
      input,
      problem,
      h("p", { class: "small muted", id: `${id}-help` }, field.help),
    );
    return { input, problem, row };
  }

  /** @param {import("../params.js").Field} field */
  _check(field) {
    const found = this.fields.get(field.name);
    if (!found) return true;
    const text = fieldProblem(field, found.input.value);
    this._mark(found, text);
    return !text;
  }

  /**
   * @param {{input: HTMLElement, problem: HTMLElement}} field
   * @param {string} text
   */
  _mark(field, text) {
    field.problem.hidden = !text;
    fill(field.problem, text);
    if (text) field.input.setAttribute("aria-invalid", "true");
    else field.input.removeAttribute("aria-invalid");
  }

  /** Whether all that was typed can be sent; what cannot is said beside it. */
  check() {
    const good = this.offered.map((field) => this._check(field)).every(Boolean);
    if (!good) this.advanced.open = true;
    return good;
  }

  /**
   * Say beside a parameter what the server says of it.
   *
   * @param {any[]} errors Of a problem document.
   * @returns {boolean} Whether each of them has found its place.
   */
  refuse(errors) {
    const places = errors.map((error) => {
      const name = (error.loc ?? []).findLast((/** @type {any} */ part) => this.fields.has(part));
      const field = this.fields.get(name);
      if (field) this._mark(field, String(error.msg ?? "Not allowed."));
      return field !== undefined;
    });
    if (places.some(Boolean)) this.advanced.open = true;
    return places.length > 0 && places.every(Boolean);
  }

  /** What the preset would choose. @param {Record<string, any>} params */
  resolved(params) {
    for (const [name, field] of this.fields) {
      const value = params[name];
      if (field.input.value !== "" || value === undefined || value === null) continue;
      if (field.input instanceof HTMLInputElement) field.input.placeholder = typeof value === "number" ? figure(value) : String(value) || "none";
      else field.input.options[0].text = `As the preset: ${[...field.input.options].find((option) => option.value === value)?.text ?? value}`;
    }
  }

  /** @param {import("../params.js").Field[]} fields */
  offerFields(fields) {
    this.offered = fields;
    this.fields = new Map(fields.map((field) => [field.name, this._field(field)]));
    fill(this.advancedGrid, [...this.fields.values()].map((field) => field.row));
  }

  /** @param {import("../vocabulary.js").Catalogue} catalogue */
  offer(catalogue) {
    this.catalogue = catalogue;
    const options = catalogue.models.map((model) =>
      h("option", { value: model.id, disabled: !model.available }, model.available ? model.title : `${model.title} (not installed)`),
    );
    fill(this.model, options, h("option", { value: OTHER }, "Another model…"));
    this.model.value = catalogue.default;
    this._modelChanged();
  }

  _modelChanged() {
    const other = this.model.value === OTHER;
    this.otherRow.hidden = !other;
    const model = this.catalogue.models.find((found) => found.id === this.model.value) ?? null;
    this.onModel(model);
    this.onChange();
  }

  /** @param {import("../params.js").Kept} kept */
  _keep(kept) {
    this.kept = kept;
    const text = keptText(kept);
    this.keptRow.hidden = !text;
    this.keptText.textContent = text && `Also as in the job before: ${text}.`;
  }

  _drop() {
    this._keep(nothingKept());
    this.onChange();
  }

  get variationCount() {
    return Math.min(MAX_VARIATIONS, Math.max(1, Math.round(Number(this.variations.value)) || 1));
  }

  /**
   * @param {string} prompt
   * @returns {import("../params.js").Wish}
   */
  wish(prompt) {
    const seed = Math.round(Number(this.seed.value));
    return {
      prompt,
      model: this.model.value === OTHER ? this.otherModel.value.trim() : this.model.value,
      preset: this.preset.value(),
      seed: Number.isSafeInteger(seed) && seed >= 0 ? seed : 0,
      variations: this.variationCount,
      morph: this.morph.checked,
      advanced: Object.fromEntries([...this.fields].map(([name, field]) => [name, field.input.value])),
      kept: this.kept,
    };
  }

  /** @param {import("../params.js").Wish} wish */
  restore(wish) {
    if (wish.model && this.catalogue.models.some((model) => model.id === wish.model)) this.model.value = wish.model;
    else if (wish.model) {
      this.model.value = OTHER;
      this.otherModel.value = wish.model;
    }
    this._modelChanged();
    this.preset.set(wish.preset);
    this.seed.value = String(wish.seed);
    this.variations.value = String(wish.variations);
    this.morph.checked = wish.morph;
    this._keep(wish.kept ?? nothingKept());
    for (const [name, field] of this.fields) field.input.value = wish.advanced[name] ?? "";
    this.advanced.open = Object.values(wish.advanced).some((value) => value !== "");
  }
}

/**
 * @param {string} name
 * @param {[string, string, string][]} options Value, label, what it means.
 * @param {string} chosen
 * @param {() => void} onChange
 */
function radios(name, options, chosen, onChange) {
  const inputs = options.map(([value]) => h("input", { type: "radio", name, value, id: uniqueId(name), ".checked": value === chosen, on: { change: onChange } }));
  const element = h(
    "div",
    { class: "cards" },
    options.map(([, label, text], index) =>
      h("label", { class: "card-choice", for: inputs[index].id }, inputs[index], h("span", { class: "card-title" }, label), h("span", { class: "small muted" }, text)),
    ),
  );
  return {
    element,
    value: () => inputs.find((input) => input.checked)?.value ?? chosen,
    set: (/** @type {string} */ value) => inputs.forEach((input) => (input.checked = input.value === value)),
  };
}
