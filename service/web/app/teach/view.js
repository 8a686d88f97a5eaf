// @ts-check
/** Teach the builtin model a word: its meshes, its names, and a job that learns them. */
import { client, errorsOf, MeshdeformError } from "../client.js";
import { fieldRow, markField } from "../create/field-rows.js";
import { intro, JobForm } from "../create/form.js";
import { fill, h, labelled, uniqueId } from "../dom.js";
import { MeshZone } from "../mesh-zone.js";
import { problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";
import { adjectives, catalogue } from "../vocabulary.js";

const STEPS = 600;

export class TeachView {
  /** @param {HTMLElement} root @param {import("../scope.js").Scope} scope */
  constructor(root, scope) {
    this.scope = scope;
    this.zone = new MeshZone(scope, {
      id: "teach-files",
      hint: "GLB, OBJ, PLY or STL, upright and facing +Z; or one ZIP of them, whose folders name what they are: tall, long-neck. Or drop them on this page.",
      empty: "One is enough to begin with; several show what they have in common.",
    });
    this.noun = textField("Word", "a gnome", "Name of the thing: one to four words.");
    this.synonyms = textField("Other names", "dwarf, garden gnome", "Separated by commas; optional.");
    this.licence = textField("Licence of the meshes", "CC0-1.0", "One line, kept with what is learned; optional.");
    this.steps = textField("Most steps", String(STEPS), `Training ends earlier when it no longer helps. Default: ${STEPS}.`);
    this.replace = h("input", { id: "teach-replace", type: "checkbox" });
    this.model = h("select", { id: "teach-model" });
    this.modelRow = labelled("teach-model", "Add the word to", this.model);
    this.modelRow.hidden = true;
    this.problem = h("div", { class: "problem-slot" });
    const form = new JobForm(scope, "New word", "Teach", { ready: () => this._ready(), send: () => this._send(), refuse: (error) => this._refuse(error) });
    form.element.append(
      this.noun.row,
      this.synonyms.row,
      this.modelRow,
      h(
        "details",
        { class: "advanced" },
        h("summary", null, "Advanced"),
        h("div", { class: "advanced-grid" }, this.licence.row, this.steps.row),
        h("label", { class: "check", for: "teach-replace" }, this.replace, "Give a word that the model knows a new meaning"),
      ),
      this.problem,
      h("div", { class: "start-bar" }, h("p", { class: "estimate" }, "A lesson takes minutes to an hour. The page may be closed meanwhile."), form.button),
    );
    fill(
      root,
      intro("Teach it", "a word", "Show the built-in model what a word means, with meshes of your own. Only you can use it afterwards."),
      h("div", { class: "create" }, this.zone.element, form.element),
    );
    this._learn();
  }

  /** Offer what a lesson can begin with: the built-in model, and words that were taught before. */
  async _learn() {
    const found = catalogue(await client.models(this.scope.signal).catch(() => ({})));
    if (this.scope.over) return;
    const taught = found.models.filter((model) => model.available && model.vocabulary);
    const builtin = taught.find((model) => model.id === "builtin");
    fill(this.model, taught.map((model) => h("option", { value: model.id }, model.id === "builtin" ? "the built-in model" : model.title)));
    if (builtin) this.model.value = "builtin";
    this.modelRow.hidden = taught.length < 2;
    if (builtin?.vocabulary) this.zone.offer(adjectives(builtin.vocabulary));
  }

  _ready() {
    fill(this.problem);
    for (const field of [this.noun, this.synonyms, this.licence, this.steps]) field.refuse("");
    const { steps, noun } = this._typed();
    if (!/^[0-9]{1,6}$/.test(steps) || Number(steps) < 1) this.steps.refuse("A whole number from 1.");
    else if (!noun) this.noun.refuse("Type the word first.");
    else if (!this.zone.files.length) this.zone.refuse("Choose at least one mesh.");
    else return true;
    return false;
  }

  _typed() {
    return { noun: this.noun.input.value.trim(), steps: this.steps.input.value.trim() || String(STEPS) };
  }

  async _send() {
    const { steps, noun } = this._typed();
    const params = {
      synonyms: this.synonyms.input.value.split(",").map((name) => name.trim()).filter(Boolean),
      replace: this.replace.checked,
      licence: this.licence.input.value.trim(),
      model: this.model.value || "builtin",
      steps: Number(steps),
    };
    const job = await client.teach(noun, await this.zone.packed("meshes.zip"), { params });
    return routeHash({ name: "job", id: job.id });
  }

  /** @param {unknown} error */
  _refuse(error) {
    if (errorsOf(error)[0]?.loc?.includes("noun") && error instanceof MeshdeformError) return this.noun.refuse(`${error.message} ${/replace/.test(error.advice) ? "Choose another word, or allow a new meaning under Advanced." : error.advice}`);
    fill(this.problem, problemBox(error));
  }
}

/** A row for a text, and the function that says what is wrong with it. @param {string} label @param {string} placeholder @param {string} help */
function textField(label, placeholder, help) {
  const row = fieldRow({ name: uniqueId("teach"), label, help, type: "text" }, ["", placeholder], () => {});
  /** @param {string} text Empty: all is well. */
  const refuse = (text) => {
    markField(row, text);
    if (text) row.input.focus();
  };
  return { ...row, refuse };
}
