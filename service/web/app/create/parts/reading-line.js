// @ts-check
/** What the asset is read as, and its front: a line to correct both in. */
import { fill, h, invalid, options, say } from "../../dom.js";
import { doubts, ELSE, frontOptions, nounOptions } from "./reading.js";

export class ReadingLine {
  /**
   * @param {(noun: string) => void} onNoun Empty: as it was read.
   * @param {(front: string) => void} onFront Degrees; empty: as it was read.
   */
  constructor(onNoun, onFront) {
    this.onNoun = onNoun;
    /** Those that this server knows; none: whatever is typed is asked for. @type {string[]} */
    this.nouns = [];
    /** What is shown, to show it again. @type {() => void} */
    this.again = () => {};
    this.before = h("span", { id: "reading-doubt" });
    this.noun = h("select", { class: "select-small", "aria-label": "What the asset is", "aria-describedby": "reading-doubt" });
    this.list = h("datalist", { id: "reading-nouns" });
    this.typed = h("input", { type: "text", class: "typed-noun", list: "reading-nouns", "aria-label": "Noun of the asset", "aria-describedby": "reading-problem", autocomplete: "off", autocapitalize: "none", hidden: true });
    this.between = h("span", { id: "front-doubt" });
    this.front = h("select", { class: "select-small", "aria-label": "Side that is the front", "aria-describedby": "front-doubt" });
    this.problem = h("p", { class: "field-problem", id: "reading-problem", "aria-live": "polite", hidden: true });
    this.element = h("div", { class: "row reading", role: "group", "aria-label": "What the asset is read as", hidden: true }, this.before, this.noun, this.typed, this.list, this.between, this.front, this.problem);
    this.noun.addEventListener("change", () => (this.noun.value === ELSE ? this._type() : onNoun(this.noun.value)));
    this.front.addEventListener("change", () => onFront(this.front.value));
    this.typed.addEventListener("change", () => this._take());
    this.typed.addEventListener("blur", () => this.typed.value.trim() || this.again());
    this.typed.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this._leave();
      if (event.key !== "Enter") return;
      event.preventDefault(); // it sends no form
      this._take();
    });
  }

  /** @param {[string, string[]][]} groups Nouns that can be typed, by their kind. */
  offer(groups) {
    this.nouns = groups.flatMap(([, nouns]) => nouns);
    fill(this.list, groups.flatMap(([group, nouns]) => nouns.map((value) => h("option", { value, label: `${value} (${group})` }))));
  }

  /** @param {import("./reading.js").Reading | null} reading @param {string} noun That somebody said. @param {string} front Likewise, in degrees. */
  show(reading, noun, front) {
    this.again = () => this.show(reading, noun, front);
    this.element.hidden = !reading && !noun;
    if (document.activeElement === this.typed) return; // it is being typed in
    this.typed.hidden = true;
    this.noun.hidden = false;
    this._say("");
    // One whose noun has no shapes cannot be read: the noun can be taken back.
    const known = reading ?? { noun, probability: 0, sure: true, nouns: [], noun_given: true, front_azimuth_deg: null, front_sure: true, front_given: false };
    const [before, between] = doubts(known, front !== "");
    say(this.before, before);
    this.between.textContent = between;
    choices(this.noun, nounOptions(known, noun), noun);
    choices(this.front, frontOptions(known, front), front);
  }

  _type() {
    this.typed.value = "";
    this.typed.hidden = false;
    this.typed.focus();
    this.noun.hidden = true;
  }

  /** Offer the choice again. */
  _leave() {
    this.noun.hidden = false;
    this.noun.focus();
    this.again();
  }

  _take() {
    const noun = this.typed.value.trim().toLowerCase().replaceAll(" ", "-");
    if (!noun) return;
    if (this.nouns.length && !this.nouns.includes(noun)) return this._say("No noun that is known here: choose one of the list.");
    this.typed.value = ""; // it is taken once
    this._leave();
    this.onNoun(noun);
  }

  /** @param {string} text What is wrong with the noun; empty: nothing. */
  _say(text) {
    say(this.problem, text);
    invalid(this.typed, text !== "");
  }
}

/** @param {HTMLSelectElement} select @param {[string, string][]} pairs Values, and words. @param {string} chosen */
function choices(select, pairs, chosen) {
  fill(select, options(pairs));
  select.value = chosen;
}
