// @ts-check
/** Words of one's own: meshes that are dropped here become a noun that prompts know; those that there are, and their meshes. */
import { toast } from "../announce.js";
import { client, errorsOf, isAbort, MeshdeformError } from "../client.js";
import { fieldRow, markField } from "../create/field-rows.js";
import { intro, JobForm, showForm } from "../create/form.js";
import { ask } from "../dialogs.js";
import { button, fill, h } from "../dom.js";
import { bytes, counted, titled } from "../format.js";
import { saveBytes } from "../job/files.js";
import { MeshZone } from "../mesh-zone.js";
import { orToast, problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";

const EXPORTED = ".word";
const SAMPLE = "dragonfruit";

export class WordsView {
  /** @param {HTMLElement} root @param {import("../scope.js").Scope} scope */
  constructor(root, scope) {
    this.scope = scope;
    this.zone = new MeshZone(scope, {
      id: "word-files",
      hint: "GLB, OBJ, PLY or STL of one kind of thing, all facing one way; or one ZIP of them; or a .word that was downloaded here. Or drop them on this page.",
      empty: "One mesh is enough. Of several, a prompt takes the nearest.",
      further: [EXPORTED],
      sample: `${SAMPLE}.glb`,
      onSample: (there) => this._named(there),
    });
    /** By the names that the API has. @type {Record<string, import("../create/field-rows.js").FieldRow>} */
    this.rows = {
      noun: textRow("noun", "Noun", "dragonfruit", "What they are, as prompts will say it."),
      synonyms: textRow("synonyms", "Other names", "pitaya", "Separated by commas; optional."),
      like: textRow("like", "What they are like", "found by their shape", "A noun that there is already; theirs are read as its parts. Optional."),
      front: textRow("front", "Where they face", "found with the parts, else +Z", "In degrees: 0 is +Z, 90 is +X. Optional."),
      licence: textRow("licence", "Licence of the meshes", "CC0-1.0", "Kept with the word; optional."),
    };
    this.replace = h("input", { id: "word-replace", type: "checkbox" });
    this.problem = h("div", { class: "problem-slot" });
    this.list = h("section", { class: "own-words", "aria-label": "Your words" });
    const { noun, synonyms, ...further } = this.rows;
    this.form = new JobForm(scope, "New word", "Add the word", { ready: () => this._ready(), send: () => this._send(), refuse: (error) => this._refuse(error), busy: "Reading the meshes…", failed: "The word was not added" });
    this.form.element.append(
      noun.row,
      synonyms.row,
      h(
        "details",
        { class: "advanced" },
        h("summary", null, "More options"),
        h("div", { class: "advanced-grid" }, Object.values(further).map(({ row }) => row)),
        h("label", { class: "check", for: "word-replace" }, this.replace, "Take the place of a word that there is already, for you"),
      ),
      this.problem,
      this.form.bar("One to three seconds a mesh."),
    );
    showForm(root, "words", intro("Words", "of your own", "Name meshes of yours, and prompts can say that name at once: as what an asset should become, or as what it is."), this.zone, this.form, this.list);
    this._show();
  }

  /** The sample comes with its noun, unless there is another one. @param {boolean} there */
  _named(there) {
    const { input } = this.rows.noun;
    if (input.value === (there ? "" : SAMPLE)) input.value = there ? SAMPLE : "";
  }

  async _show() {
    try {
      const words = await client.words(this.scope.signal);
      if (this.scope.over) return;
      const all = words.map((word) => ({ word, frame: h("div", { class: "own-word-picture" }) }));
      fill(this.list, h("h2", null, words.length ? `Your ${counted(words.length, "word")}` : "No words yet"), h("ul", null, all.map(({ word, frame }) => this._item(word, frame))));
      for (const { word, frame } of all) await this._draw(word, frame); // one at a time: each takes a process of the server
    } catch (error) {
      if (!this.scope.over && !isAbort(error)) fill(this.list, problemBox(error));
    }
  }

  /** @param {any} word @param {HTMLElement} frame */
  async _draw(word, frame) {
    const picture = await client.drawWord(word.noun, this.scope.signal).catch(() => null);
    if (picture && !this.scope.over) fill(frame, h("img", { src: this.scope.url(picture), alt: `Meshes of ${word.noun}`, loading: "lazy" }));
  }

  /** @param {any} word @param {HTMLElement} frame Of its picture. */
  _item(word, frame) {
    const said = [
      counted(word.meshes, "mesh", "meshes"),
      `${counted(word.faces, "face")}, ${bytes(word.size)}`,
      word.synonyms.length ? `also ${word.synonyms.join(", ")}` : "",
      word.like ? `like ${word.like}` : "",
      word.parts.length ? `parts: ${word.parts.join(", ")}` : "no parts",
    ];
    return h(
      "li",
      { class: "own-word" },
      frame,
      h("div", null, h("h3", null, titled(word.noun)), h("p", { class: "small muted" }, said.filter(Boolean).join(" · "))),
      h(
        "div",
        { class: "row" },
        button(`Download ${word.noun}`, () => this._save(word.noun), { icon: "download", quiet: true, class: "button-quiet" }),
        button(`Remove ${word.noun}`, () => this._remove(word.noun), { icon: "trash", quiet: true, class: "button-quiet" }),
      ),
    );
  }

  /** @param {string} noun */
  _save(noun) {
    return orToast("No file", async () => saveBytes(await client.exportWord(noun, this.scope.signal), noun + EXPORTED));
  }

  /** @param {string} noun */
  _remove(noun) {
    const act = async () => {
      await client.deleteWord(noun);
      toast(`${titled(noun)} removed`);
      this._show();
    };
    ask({ title: `Remove ${noun}?`, body: [h("p", null, "Prompts no longer know it. Jobs that have it keep it.")], action: "Remove", danger: true, act }, this.scope);
  }

  /** Whether what was chosen are exported words, and no meshes. */
  get _exported() {
    return this.zone.files.length > 0 && this.zone.files.every(({ name }) => name.endsWith(EXPORTED));
  }

  _ready() {
    fill(this.problem);
    for (const row of Object.values(this.rows)) markField(row, "");
    const front = this.rows.front.input.value.trim();
    if (!this.zone.files.length) this.zone.refuse("Choose at least one mesh.");
    else if (this._exported) return true;
    else if (this.zone.files.some(({ name }) => name.endsWith(EXPORTED))) this.zone.refuse("Add a .word by itself: it has its meshes and its noun.");
    else if (!this.rows.noun.input.value.trim()) this._mark("noun", "Say what they are first.");
    else if (front && !Number.isFinite(Number(front))) this._mark("front", "Enter a number.");
    else return true;
    return false;
  }

  async _send() {
    const added = this._exported ? await this._imported() : [await client.addWord(this.zone.files, this._request())];
    for (const { input } of Object.values(this.rows)) input.value = "";
    this.replace.checked = false;
    this.zone.clear();
    toast(`Added: ${added.map(({ noun }) => noun).join(", ")}`);
    this._show();
    return routeHash({ name: "words" });
  }

  async _imported() {
    const added = [];
    for (const file of this.zone.files) added.push(...(await client.importWords(file, { replace: this.replace.checked })));
    return added;
  }

  _request() {
    const { noun, synonyms, like, licence, front } = Object.fromEntries(Object.entries(this.rows).map(([name, { input }]) => [name, input.value.trim()]));
    const names = synonyms.split(",").map((name) => name.trim()).filter(Boolean);
    return { noun, synonyms: names, like, licence, replace: this.replace.checked, ...(front ? { front: Number(front) } : {}) };
  }

  /** @param {unknown} error */
  _refuse(error) {
    const found = error instanceof MeshdeformError ? error : null;
    const name = errorsOf(error)[0]?.loc?.[0];
    const advice = /replace/.test(found?.advice ?? "") ? "Choose another noun, or take its place under More options." : found?.advice;
    const words = found ? [found.message, advice].filter(Boolean).join(" ") : "";
    if (found && name in this.rows) return this._mark(name, words);
    if (found?.code.startsWith("asset_")) return this.zone.refuse(words);
    fill(this.problem, problemBox(error));
  }

  /** @param {string} name @param {string} text What is wrong with it. */
  _mark(name, text) {
    const row = this.rows[name];
    const fold = row.row.closest("details");
    if (fold) fold.open = true;
    markField(row, text);
    row.input.focus();
  }
}

/** @param {string} name @param {string} label @param {string} placeholder @param {string} help */
function textRow(name, label, placeholder, help) {
  return fieldRow({ name: `word-${name}`, label, help }, placeholder);
}
