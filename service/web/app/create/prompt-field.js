// @ts-check
/** The prompt, the words that the model knows, and what is wrong with the prompt. */
import { chip, fill, h, icon, invalid, labelled } from "../dom.js";
import { titled } from "../format.js";
import { showRefusal } from "../refusal.js";
import { ownNouns, withArticle } from "../vocabulary.js";

const EXAMPLES_SHOWN = 5;
const LONGEST = 1000;

export class PromptField {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    this.input = h("textarea", {
      id: "prompt", rows: 2, maxlength: LONGEST, spellcheck: "true", placeholder: "a mushroom", autocapitalize: "none",
      "aria-describedby": "prompt-problem prompt-note", enterkeyhint: "go",
    });
    this.problem = h("div", { class: "field-problem", id: "prompt-problem", "aria-live": "polite", hidden: true });
    this.note = h("p", { class: "prior-note", id: "prompt-note" });
    this.chips = h("div", { class: "chips", role: "group", "aria-label": "Suggested prompts" });
    this.words = h("div", null);
    this.element = labelled("prompt", "Prompt", this.input, this.problem, this.chips, this.words, this.note);
    this.input.addEventListener("input", onChange);
    this.input.addEventListener("keydown", (event) => {
      // A prompt has no lines: Enter starts.
      if (event.key !== "Enter" || event.shiftKey || event.isComposing) return;
      event.preventDefault();
      this.input.form?.requestSubmit();
    });
  }

  get value() {
    return this.input.value.trim();
  }

  /** @param {string} text */
  set(text) {
    this.input.value = text;
    this.onChange();
  }

  /** Take a prompt that was offered. @param {string} text */
  take(text) {
    this.set(text);
    this.input.focus();
  }

  /**
   * @param {import("../vocabulary.js").Model | null} model
   * @param {boolean} others Whether there are models to choose that take free text.
   * @param {boolean} byShape Whether no model is asked: there are shapes of the words that it knows.
   */
  offer(model, others, byShape) {
    const known = model?.vocabulary;
    /** @type {string[]} */
    const examples = known ? [...ownNouns(known).map(withArticle), ...known.examples].slice(0, EXAMPLES_SHOWN) : [];
    fill(this.chips, examples.map((text) => chip(text, () => this.set(text), { small: false })));
    this.chips.hidden = !examples.length;
    fill(this.words, known?.nouns.length ? this._allWords(known) : null);
    const freely = others ? "For free text, choose another model." : "For free text, the server needs a Stable Diffusion model.";
    const note = !known ? (model?.description ?? "") : byShape ? "" : `The built-in model knows ${known.nouns.length} things and little else. ${freely}`;
    this.note.hidden = !note;
    fill(this.note, icon("info"), h("span", null, note));
  }

  /** @param {import("../vocabulary.js").Vocabulary} known */
  _allWords(known) {
    const group = (/** @type {string} */ title, /** @type {string[]} */ nouns) => [
      h("p", { class: "field-label" }, title),
      h("div", { class: "chips", role: "group", "aria-label": title }, nouns.map((noun) => chip(noun, () => this.set(withArticle(noun))))),
    ];
    return h(
      "details",
      { class: "words" },
      h("summary", null, `All ${known.nouns.length} nouns`),
      known.groups.flatMap(([name, nouns]) => group(titled(name), nouns)),
      h("p", { class: "small muted" }, "Parts can have sizes too: “a giraffe with a long neck and short legs”."),
    );
  }

  /** @param {unknown} error Null: all is well. */
  refuse(error) {
    this.problem.hidden = !error;
    this.chips.classList.toggle("replaced", Boolean(error));
    invalid(this.input, Boolean(error));
    if (!error) return void fill(this.problem);
    showRefusal(this.problem, error, (text) => this.take(text));
  }
}
