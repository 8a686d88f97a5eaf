// @ts-check
/** What the asset is read as, and its parts, to point at: words and a slider change one of them. */
import { announce } from "../../announce.js";
import { isAbort, MeshdeformError } from "../../client.js";
import { chip, h, refill, say } from "../../dom.js";
import { plainWords } from "../../plain.js";
import { debounced } from "../../scope.js";
import { slider } from "../../widgets.js";
import { Corrector } from "./corrector.js";
import { isUnsure, originWords, readingSentence } from "./reading.js";
import { ReadingLine } from "./reading-line.js";
import { LEAST, MOST, partAt, sentenceOf, withWanted } from "./sentence.js";
import { Slides } from "./slides.js";

/** @typedef {import("./sentence.js").Part} Part */
/** @typedef {import("./sentence.js").Change} Change */
/** @typedef {{reading?: import("./reading.js").Reading | null, parts: Part[]}} Found */

const SHOWN = 8; // or one more, instead of a button for it
const STEP = 5;
const USUAL = 30; // percent that a word asks for

export class PartsPanel {
  /**
   * @param {import("../../viewer-box.js").ViewerBox} box
   * @param {import("../control/panel.js").ControlPanel} panel Holds what was said of the asset.
   * @param {import("../../scope.js").Scope} scope
   * @param {object} does
   * @param {(signal: AbortSignal) => Promise<Found>} does.ask The server, about the asset in the form.
   * @param {(prompt: string, form: "glb" | "positions", signal: AbortSignal) => Promise<ArrayBuffer>} does.change The server, for the asset changed.
   * @param {(prompt: string) => void} does.write The prompt.
   */
  constructor(box, panel, scope, does) {
    this.box = box;
    this.panel = panel;
    this.view = panel.view;
    this.does = does;
    this.slides = new Slides(box, does.change);
    /** What the parts were asked for: the asset, and what else they depend on. */
    this.of = "";
    /** What a person said of it. */
    this.said = "";
    /** Whether this server can find parts: that of a stack may have no scipy. */
    this.able = true;
    /** @type {import("./reading.js").Reading | null} */
    this.reading = null;
    /** @type {Part[]} */
    this.parts = [];
    /** @type {Part | null} */
    this.part = null;
    /** @type {Change | null} */
    this.change = null;
    /** @type {import("./sentence.js").Wanted[]} */
    this.wanted = [];
    /** The prompt as it was written here; another one is the user's own. */
    this.written = "";
    /** Whether the view shows another shape than the asset's. */
    this.changed = false;
    /** Whether all parts are listed. */
    this.all = false;
    /** Told when the asset has been read. */
    this.onRead = () => {};
    this.finding = new AbortController();
    scope.add(() => (this.finding.abort(), this.slides.forget()));
    this.find = debounced(() => this._find(), 400, scope);
    this.sentence = h("p", { class: "reading-words", hidden: true });
    this.chips = h("div", { class: "chips", role: "group", "aria-label": "Parts" });
    this.words = h("div", { class: "chips", role: "group" });
    const { input, value, row } = slider("part-slider", "Amount", MOST, () => this._slide(Number(input.value)));
    input.min = String(LEAST);
    input.step = String(STEP);
    this.input = input;
    this.output = value;
    this.row = row;
    this.note = h("p", { class: "small muted", role: "status", hidden: true });
    this.line = new ReadingLine((noun) => panel.correct({ noun }), (front) => panel.correct({ front }));
    this.kept = h("div", { class: "chips", role: "group" });
    this.corrector = new Corrector(panel, scope, (part) => this._origin(part), (parts, name) => this._rename(parts, name));
    panel.reader = { press: () => (this.corrector.press(), this._keep()), refuse: (text) => say(this.note, plainWords(text) || "That cannot be said of it.") };
    this.wrong = h("details", { class: "advanced not-right" }, h("summary", null, "Not right?"), this.line.element, this.corrector.element);
    this.element = h("div", { class: "parts", hidden: true }, this.sentence, h("div", { class: "read" }, this.chips), this.words, row, this.kept, this.note, this.wrong);
  }

  /**
   * Look again, if what the parts depend on is other than before.
   * @param {string} of Empty: there is nothing to find.
   * @param {string} said What a person said of it; another asking keeps what is shown.
   * @param {string} prompt As it is in the form.
   */
  suit(of, said, prompt) {
    if (of !== this.of || said !== this.said) {
      const other = of !== this.of;
      this.of = of;
      this.said = said;
      if (other) this._forget();
      if (of && this.able) this._look();
    }
    if (prompt === this.written) return;
    this.written = prompt;
    this.wanted = [];
    this._draw();
  }

  _forget() {
    this.finding.abort();
    this.slides.forget();
    this.reading = null;
    this.parts = [];
    this.wanted = [];
    this.all = false;
    this._choose(null);
  }

  /** Ask, and say so where nothing is shown yet. */
  _look() {
    this.finding.abort();
    this.element.setAttribute("aria-busy", "true");
    say(this.note, this.parts.length ? "" : "Reading the asset…");
    this._draw();
    this.find();
  }

  async _find() {
    if (!this.of) return;
    const asked = (this.finding = new AbortController());
    const found = await this._answer(asked);
    if (asked.signal.aborted) return;
    this.element.setAttribute("aria-busy", "false");
    if (!found && !this.said) say(this.note, "");
    if (!found) return this._draw();
    this.reading = found.reading ?? null;
    this.parts = found.parts;
    if (this.parts.length) this.view.touch((face) => this._touched(face));
    say(this.note, this.parts.length ? "" : "No parts are known for this file.");
    const chosen = this.corrector.painting ?? this.part?.name;
    this._choose(this.parts.find(({ name }) => name === chosen) ?? null);
    this.onRead();
  }

  /** @param {AbortController} asked @returns {Promise<Found | null>} Null where there is none, or it is asked for no more. */
  async _answer(asked) {
    try {
      const found = await this.does.ask(asked.signal);
      return asked.signal.aborted ? null : found;
    } catch (error) {
      if (asked.signal.aborted || isAbort(error)) return null;
      if (error instanceof MeshdeformError && error.code === "dependency_missing") this.able = false;
      else if (this.said) say(this.note, error instanceof MeshdeformError ? plainWords(error.message) || error.title : String(error));
      return null;
    }
  }

  /** @param {Part | null} part */
  _choose(part) {
    this.part = part;
    this.change = part?.changes[0] ?? null;
    const before = this.wanted.findLast((each) => each.part === part?.name);
    if (before) this.change = before.change;
    if (part && this.change) void this.slides.learn(part.name, this.change);
    this.view.showPart(part?.faces ?? null);
    this._draw();
  }

  /** What was asked of parts is asked of them by the name that they have now. @param {string[]} parts @param {string} name */
  _rename(parts, name) {
    if (this.part && parts.includes(this.part.name)) this.part = { ...this.part, name };
    if (!this.wanted.some(({ part }) => parts.includes(part))) return;
    this.wanted = this.wanted.map((each) => (parts.includes(each.part) ? { ...each, part: name } : each));
    this.written = sentenceOf(this.wanted);
    this.does.write(this.written);
  }

  /** @param {Part | null} part That a person points at. */
  _pick(part) {
    if (this.corrector.painting !== part?.name) this.corrector.rest();
    this._choose(part);
  }

  /** @param {number} face That was clicked. */
  _touched(face) {
    if (!this.parts.length) return;
    const part = partAt(this.parts, face);
    announce(part ? `${part.name} chosen` : "No part that words can name");
    this._pick(part);
  }

  /** @param {Change} change @param {number} percent */
  _ask(change, percent) {
    if (!this.part) return;
    this.change = change;
    void this.slides.learn(this.part.name, change);
    this.wanted = withWanted(this.wanted, { part: this.part.name, change, percent });
    // Until the server has answered, the mesh goes straight there.
    if (this.slides.show(this.wanted)) this.view.showPart(null);
    this.written = sentenceOf(this.wanted);
    this.does.write(this.written);
    this._draw();
  }

  /** @param {number} percent */
  _slide(percent) {
    if (this.change) this._ask(this.change, percent);
  }

  /** Percent that is asked of an operation on the chosen part. @param {Change | null} change */
  _percent(change) {
    return this.wanted.find((each) => each.part === this.part?.name && each.change.operation === change?.operation)?.percent ?? 0;
  }

  /** What the view shows has another shape. @param {boolean} changed Whether it is not the asset. */
  reshaped(changed) {
    this.changed = changed;
    this.view.reshape();
    this.view.showPart(changed ? null : (this.part?.faces ?? null));
  }

  _draw() {
    const { part, change } = this;
    const known = this.reading !== null || this.parts.length > 0 || this.corrector.any;
    this.element.hidden = !this.of || (!known && this.note.hidden);
    this.line.show(this.reading, this.panel.control.noun, this.panel.control.front);
    this.wrong.hidden = !known;
    say(this.sentence, this.reading ? readingSentence(this.reading, this.parts.length) : "");
    this.corrector.show(this.parts, part);
    const all = this.parts.filter((each, at) => this.all || at < SHOWN || each === part || this.parts.length === SHOWN + 1);
    const more = this.parts.length - all.length;
    refill(this.chips, [...all.map((each) => this._chip(each)), more ? chip(`${more} more`, () => this._more(), { small: false }) : null]);
    this.words.setAttribute("aria-label", `What becomes of the ${part?.name}`);
    refill(this.words, (part?.changes ?? []).flatMap((each) => [this._word(each, 1), this._word(each, -1)]));
    this._keep();
    this.words.hidden = this.row.hidden = !change;
    if (!change || !part) return;
    const percent = this._percent(change);
    this.input.value = String(percent);
    this.output.textContent = percent ? `${percent > 0 ? "+" : "−"}${Math.abs(percent)} %` : "as it is";
    const words = percent ? `${part.name} ${percent < 0 ? change.less : change.more} by ${Math.abs(percent)} percent` : `${part.name} as it is`;
    this.input.setAttribute("aria-valuetext", words);
  }

  /** Offer to keep the part that is chosen, or to move it alone. */
  _keep() {
    const { part } = this;
    this.kept.hidden = !part;
    if (!part) return;
    this.kept.setAttribute("aria-label", `What happens to the ${part.name}`);
    const chosen = this.panel.actionOf(part);
    const pairs = /** @type {[string, string][]} */ ([["keep", "Keep as it is"], ["only", "Only this moves"]]);
    refill(this.kept, pairs.map(([action, text]) => chip(text, () => this.panel.mark(part, action), { "aria-pressed": String(chosen === action) })));
  }

  _more() {
    this.all = true;
    this._draw();
    /** @type {HTMLElement | undefined} */ (this.chips.children[SHOWN])?.focus();
  }

  /** @param {Part} part @returns {string} */
  _origin(part) {
    return originWords(part, this.reading, this.corrector.corrects(part));
  }

  /** @param {Part} part */
  _chip(part) {
    const glance = () => this.view.showPart(part.faces);
    const leave = () => this.view.showPart(this.changed ? null : (this.part?.faces ?? null));
    const act = () => this._pick(part === this.part ? null : part);
    const on = { click: act, pointerenter: glance, pointerleave: leave, focus: glance, blur: leave };
    const unsure = isUnsure(part, this.reading);
    const kind = unsure ? "chip-unsure" : part.found_by === "given" ? "chip-given" : "";
    return chip(unsure ? `perhaps ${part.name}` : part.name, act, { small: false, class: kind, "aria-pressed": String(part === this.part), title: this._origin(part), on });
  }

  /** @param {Change} change @param {1 | -1} sign */
  _word(change, sign) {
    const pressed = change.operation === this.change?.operation && this._percent(change) * sign > 0;
    return chip(sign > 0 ? change.more : change.less, () => this._ask(change, pressed ? 0 : sign * USUAL), { "aria-pressed": String(pressed) });
  }
}
