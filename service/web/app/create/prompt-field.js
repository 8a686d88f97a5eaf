// @ts-check
/** The prompt, what the prior knows of words, and what is wrong with the prompt. */
import { ProblemError } from "../api.js";
import { button, fill, h, icon } from "../dom.js";
import { adjectives, surprise, withAdjective, withNoun } from "../vocabulary.js";

const EXAMPLES_SHOWN = 5;

export class PromptField {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {import("../vocabulary.js").Model | null} */
    this.model = null;
    this.input = h("textarea", {
      id: "prompt", rows: 2, maxlength: 1000, spellcheck: "true", placeholder: "a mushroom", autocapitalize: "none",
      "aria-describedby": "prompt-problem prompt-note", enterkeyhint: "go",
    });
    this.problem = h("div", { class: "field-problem", id: "prompt-problem", "aria-live": "polite", hidden: true });
    this.note = h("p", { class: "prior-note", id: "prompt-note" });
    this.chips = h("div", { class: "chips", role: "group", "aria-label": "Suggested prompts" });
    this.words = h("div", null);
    this.element = h(
      "div",
      { class: "field" },
      h("label", { class: "field-label", for: "prompt" }, "Prompt"),
      this.input,
      this.problem,
      this.chips,
      this.words,
      this.note,
    );
    this.input.addEventListener("input", () => this._changed());
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
    this._changed();
  }

  _changed() {
    this._press();
    this.onChange();
  }

  _press() {
    /** @type {string[]} */
    const words = this.input.value.toLowerCase().match(/[a-z]+/g) ?? [];
    for (const chip of this.words.querySelectorAll("button[data-word]")) {
      chip.setAttribute("aria-pressed", String(words.includes(/** @type {HTMLElement} */ (chip).dataset.word ?? "")));
    }
  }

  /** @param {import("../vocabulary.js").Model | null} model */
  offer(model) {
    this.model = model;
    const known = model?.vocabulary;
    /** @type {string[]} */
    const examples = known ? known.examples.slice(0, EXAMPLES_SHOWN) : [];
    fill(
      this.chips,
      examples.map((text) => h("button", { type: "button", class: "chip", on: { click: () => this.set(text) } }, text)),
      known?.nouns.length
        ? button("Surprise me", () => this.set(surprise(known)), { icon: "dice", class: "chip" })
        : null,
    );
    this.chips.hidden = !this.chips.childElementCount;
    fill(this.words, known && known.nouns.length ? this._allWords(known) : null);
    this.note.hidden = !known && !model?.description;
    fill(
      this.note,
      known
        ? [
            icon("info"),
            h("span", null, `The builtin prior is a demonstration: it knows ${known.nouns.length} nouns and little else. `
              + "For any other prompt, run a Stable Diffusion model behind this server."),
          ]
        : [icon("info"), h("span", null, model?.description ?? "")],
    );
    this._press();
  }

  /** @param {import("../vocabulary.js").Vocabulary} known */
  _allWords(known) {
    const chip = (/** @type {string} */ word, /** @type {() => string} */ text) =>
      h("button", { type: "button", class: "chip chip-small", "aria-pressed": "false", data: { word }, on: { click: () => this.set(text()) } }, word);
    return h(
      "details",
      { class: "words" },
      h("summary", null, `All ${known.nouns.length} nouns and ${adjectives(known).length} attributes`),
      h("p", { class: "field-label" }, "Nouns"),
      h("div", { class: "chips", role: "group", "aria-label": "Nouns" }, known.nouns.map((noun) => chip(noun, () => withNoun(this.value, noun, known)))),
      h("p", { class: "field-label" }, "Attributes of the whole"),
      h(
        "div",
        { class: "chips", role: "group", "aria-label": "Attributes" },
        adjectives(known).map((word) => chip(word, () => withAdjective(this.value, word, known))),
      ),
      h("p", { class: "small muted" }, "Parts take sizes, too: “a giraffe with a long neck and short legs”. At most three attributes."),
    );
  }

  /** @param {unknown} error Null: all is well. */
  refuse(error) {
    this.problem.hidden = !error;
    if (error) this.input.setAttribute("aria-invalid", "true");
    else this.input.removeAttribute("aria-invalid");
    if (!error) return void fill(this.problem);
    const problem = error instanceof ProblemError ? error : null;
    const suggestions = Object.entries(problem?.document.corrections ?? {}).map(([word, close]) => [word, String(close)]);
    fill(
      this.problem,
      h("strong", null, problem ? problem.message : String(error)),
      suggestions.map(([word, close]) =>
        h("button", { type: "button", class: "chip", on: { click: () => this.set(replaceWord(this.value, word, close)) } }, `Use “${close}”`),
      ),
      problem?.advice ? h("p", { class: "advice", tabindex: "0" }, problem.advice) : null,
    );
  }
}

/**
 * @param {string} text
 * @param {string} word In small letters.
 * @param {string} other
 */
function replaceWord(text, word, other) {
  const at = text.toLowerCase().indexOf(word);
  return at < 0 ? other : text.slice(0, at) + other + text.slice(at + word.length);
}
