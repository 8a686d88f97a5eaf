// @ts-check
/**
 * Many files at once: each is read, one sentence acts on all, and before and after hang on a wall. What is kept are jobs
 * of one group, which the address names: with it they come back.
 */
import { announce } from "../announce.js";
import { exampleAsset, FORMATS } from "../assets.js";
import { client, isAbort } from "../client.js";
import { intro, kindsNav } from "../create/form.js";
import { button, chip, fill, h, icon } from "../dom.js";
import { bytes, counted } from "../format.js";
import { isTerminal } from "../history.js";
import { saveBytes } from "../job/files.js";
import { slug } from "../names.js";
import { chosenFile, droppedFiles, fileInput, takeDrops, takeHandedMany } from "../picking.js";
import { orToast, problemBox } from "../problem-box.js";
import { routeHash } from "../router.js";
import { SAMPLES } from "../samples.js";
import { debounced } from "../scope.js";
import { ManyCard } from "./card.js";
import { lookCloser } from "./closer.js";
import { archiveOf, MOST_FILES, sorted } from "./files.js";
import { csvRow, Item, resultNames, tally } from "./item.js";
import { ManyWork } from "./work.js";

const PAUSE_MS = 600;
const POLL_MS = 1500;
/** Cards of a group, whose files may have been kept in several shapes. */
const MOST_SHOWN = 4 * MOST_FILES;
const IDEAS = ["20 % taller", "bigger head", "longer legs", "a chair"];

export class ManyView {
  /** @param {HTMLElement} root @param {import("../scope.js").Scope} scope @param {string} group Of the jobs that are shown again; empty: none. */
  constructor(root, scope, group) {
    this.scope = scope;
    this.group = group;
    /** @type {Item[]} */
    this.items = [];
    /** @type {Map<Item, ManyCard>} */
    this.cards = new Map();
    this.sentence = "";
    /** Whether all that hangs here are samples, which give way to files of the user's. */
    this.sample = false;
    this.polling = false;
    this.work = new ManyWork(scope, (item, pictures) => this._worked(item, pictures), () => announce(this.tally.textContent ?? ""));
    const accept = [...FORMATS.map((ending) => `.${ending}`), ".gltf", ".bin", ".mtl", ".png", ".jpg", ".jpeg", ".webp"].join(",");
    this.input = fileInput("many-files", "Asset files", accept, (files) => this._take(files.map(chosenFile)), true);
    this.folder = fileInput("many-folder", "Folder of assets", "", (files) => this._take(files.map(chosenFile)), true);
    this.folder.setAttribute("webkitdirectory", "");
    this.left = h("div", { class: "small muted", role: "status" });
    this.field = h("input", { type: "text", id: "many-sentence", maxlength: 500, autocomplete: "off", placeholder: "20 % taller", "aria-describedby": "many-tally" });
    this.problem = h("div", { class: "problem-slot" });
    this.tally = h("p", { class: "small muted", id: "many-tally" });
    this.keep = button("Keep all", () => this._keep(), { icon: "check", class: "button-primary" });
    this.save = button("Download ZIP", () => this._download(), { icon: "download" });
    this.clear = button("Clear the wall", () => this._clear(), { icon: "cross", class: "button-quiet" });
    this.wall = h("ul", { class: "many-wall", "aria-label": "Before and after" });
    const changed = debounced(() => this._say(this.field.value), PAUSE_MS, scope);
    this.field.addEventListener("input", changed);
    fill(root, intro("Many files,", "one sentence", "Drop a folder: each asset is read for what it is, and all become what you say."), kindsNav("many"), this._panel(), this.problem, this.wall);
    takeDrops(scope, root, (_files, _target, transfer) => this._dropped(droppedFiles(transfer)));
    const handed = takeHandedMany();
    if (handed) void this._dropped(handed);
    else void (group ? this._restore() : this._samples());
  }

  _panel() {
    const ideas = IDEAS.map((idea) => chip(idea, () => (this.field.value = idea, this._say(idea))));
    return h(
      "section",
      { class: "panel many-panel", "aria-label": "All files" },
      h("div", { class: "drop-veil", "aria-hidden": "true" }, icon("upload"), h("strong", null, "Drop them here")),
      h("div", { class: "row" }, button("Choose files", () => this.input.click(), { icon: "upload" }), button("Choose a folder", () => this.folder.click(), { icon: "upload" }), this.input, this.folder, h("span", { class: "small muted with-mouse" }, "Or drop files, a folder or a ZIP."), this.left),
      h("form", { class: "many-form", on: { submit: (/** @type {Event} */ event) => (event.preventDefault(), this._say(this.field.value)) } }, h("label", { class: "field-label", for: "many-sentence" }, "What all should become"), this.field, h("div", { class: "chips", role: "group", "aria-label": "Sentences to try" }, ideas)),
      h("div", { class: "row" }, this.keep, this.save, this.clear, this.tally),
    );
  }

  /** Nothing opens empty. */
  async _samples() {
    try {
      const assets = await Promise.all(SAMPLES.map(({ name }) => exampleAsset(name, this.scope.signal)));
      if (this.scope.over || this.items.length) return;
      this.sample = true;
      this._hang(assets.map((asset) => new Item(asset.name, asset, true)));
      fill(this.left, "Samples, which your files take the place of.");
    } catch (error) {
      if (!isAbort(error) && !this.scope.over) fill(this.problem, problemBox(error));
    }
  }

  /** Hang the jobs of the group again. */
  async _restore() {
    try {
      const jobs = [];
      for await (const job of client.jobs({ limit: 200, metadata: { group: this.group }, signal: this.scope.signal })) {
        if (jobs.push(job) === MOST_SHOWN) break;
      }
      if (this.scope.over) return;
      if (!jobs.length) fill(this.problem, h("p", { class: "lead" }, "Nothing is kept here any more."));
      this.field.value = this.sentence = new Set(jobs.map(({ prompt }) => prompt)).size === 1 ? jobs[0].prompt : "";
      this._hang(jobs.reverse().map((job) => Item.of(job)));
      void this._poll();
    } catch (error) {
      if (!isAbort(error) && !this.scope.over) fill(this.problem, problemBox(error));
    }
  }

  /** @returns {Promise<any[]>} the newest of the group: those that run are among them */
  async _jobs() {
    return (await client.jobPage({ limit: 200, metadata: { group: this.group }, signal: this.scope.signal })).jobs;
  }

  /** @param {Promise<import("../picking.js").Found[]>} files */
  _dropped(files) {
    return orToast("Not read", async () => this._take(await files));
  }

  /** @param {import("../picking.js").Found[]} found */
  async _take(found) {
    if (!found.length) return;
    fill(this.left, "Looking at the files…");
    const known = this.sample ? [] : this.items.flatMap(({ path, asset }) => (asset ? [{ path, asset }] : []));
    const { assets, left } = await sorted(found, known);
    if (this.scope.over) return;
    if (assets.length && this.sample) this._clear();
    this.sample &&= !assets.length;
    this._hang(assets.map(({ path, asset }) => new Item(path, asset)));
    fill(this.left, left.map((text) => h("p", null, text)));
    if (assets.length) announce(`${counted(assets.length, "asset")} added`);
  }

  /** @param {Item[]} items */
  _hang(items) {
    for (const item of items) {
      const card = new ManyCard(item, this.scope, {
        look: (each) => this._look(each),
        again: (each) => this._again(each),
        remove: (each) => this._remove(each),
      });
      this.items.push(item);
      this.cards.set(item, card);
      this.wall.append(card.element);
    }
    this._go();
  }

  /** @param {Item} item */
  _remove(item) {
    const at = this.items.indexOf(item);
    const focused = this.cards.get(item)?.element.contains(document.activeElement);
    this.items.splice(at, 1);
    this.cards.get(item)?.element.remove();
    this.cards.delete(item);
    this.work.forget(item);
    if (focused) (this.cards.get(this.items[Math.min(at, this.items.length - 1)])?.look ?? this.field).focus();
    this._go();
  }

  /** Take all off the wall; what was kept stays among the jobs. */
  _clear() {
    for (const item of [...this.items]) this._remove(item);
    this.group = "";
    if (location.hash !== routeHash({ name: "many" })) history.replaceState(null, "", routeHash({ name: "many" }));
    fill(this.left);
    fill(this.problem);
  }

  /** @param {string} text */
  _say(text) {
    const sentence = text.trim();
    if (sentence === this.sentence) return;
    this.sentence = sentence;
    this.work.stop("change");
    this._go();
  }

  /** Do what is to be done, and show how far it is. */
  _go() {
    this.work.go(this.items, this.sentence);
    this._show();
  }

  _show() {
    for (const card of this.cards.values()) card.show(this.sentence);
    const ready = this.items.filter((item) => item.state(this.sentence) === "changed").length;
    this.keep.hidden = this.save.hidden = this.clear.hidden = !this.items.length;
    this.keep.disabled = !ready;
    this.keep.lastChild?.replaceWith(ready ? `Keep ${ready === this.items.length ? "all" : ""} ${ready}`.replace("  ", " ") : "Keep all");
    this.save.disabled = !this._results().length;
    this.tally.textContent = this.items.length ? `${counted(this.items.length, "file")}: ${tally(this.items, this.sentence)}` : "";
  }

  /** @param {Item} item @param {(Blob | null)[]} pictures */
  _worked(item, pictures) {
    this.cards.get(item)?.picture(pictures);
    this._go();
  }

  /** @param {Item} item */
  async _again(item) {
    if (item.keeps(this.sentence) && item.failure) {
      await orToast("Not started", async () => {
        item.job = await client.retry(item.job);
        void this._poll();
      });
    }
    item.why = null;
    this._go();
  }

  /** @param {Item} item */
  _look(item) {
    return orToast("Not shown", async () => {
      const [asset, result] = await this.work.files(item, this.sentence);
      if (!this.scope.over) lookCloser(item.path, asset, result, this.scope);
    });
  }

  /** Make jobs of what is ready: their files and reports stay. */
  async _keep() {
    if (this.keep.getAttribute("aria-busy") === "true") return;
    this.keep.setAttribute("aria-busy", "true");
    const { sentence } = this;
    this.group ||= "m" + Date.now().toString(36) + Math.floor(Math.random() * 1e6).toString(36);
    history.replaceState(null, "", routeHash({ name: "many", id: this.group }));
    let kept = 0;
    for (const item of this.items.filter((each) => each.state(sentence) === "changed")) {
      if (this.scope.over || !this.items.includes(item)) continue;
      await this.work.keep(item, sentence, this.group);
      kept += item.keeps(sentence) ? 1 : 0;
      this._show();
      void this._poll();
    }
    this.keep.setAttribute("aria-busy", "false");
    announce(`${counted(kept, "job")} started`);
  }

  /** Ask how the jobs are until all have ended. */
  async _poll() {
    if (this.polling) return;
    this.polling = true;
    while (!this.scope.over && this.items.some(({ job }) => job && !isTerminal(job.state))) {
      try {
        if (!document.hidden) await this._follow();
        fill(this.problem);
      } catch (error) {
        if (isAbort(error) || this.scope.over) break;
        fill(this.problem, problemBox(error));
      }
      await this.scope.sleep(POLL_MS);
    }
    this.polling = false;
  }

  async _follow() {
    const jobs = new Map((await this._jobs()).map((job) => [job.id, job]));
    const ended = this.items.filter((item) => item.job && !isTerminal(item.job.state) && isTerminal(jobs.get(item.job.id)?.state ?? ""));
    for (const item of this.items) item.job = (item.job && jobs.get(item.job.id)) ?? item.job;
    this._show();
    for (const item of ended) if (item.job.state === "succeeded") await this.work.judge(item);
    if (ended.length) this._go();
  }

  /** What a ZIP can have: results that are kept, and those that are ready. */
  _results() {
    return this.items.filter((item) => ["changed", "succeeded"].includes(item.state(this.sentence)));
  }

  async _download() {
    const items = this._results();
    const { sentence } = this;
    const names = resultNames(items.map(({ path }) => path));
    const label = this.save.lastChild;
    const { work } = this;
    this.save.disabled = true;
    await orToast("No ZIP", async () => {
      async function* files() {
        for (const [k, item] of items.entries()) {
          if (label) label.textContent = `Packing ${k + 1} of ${items.length}`;
          yield { name: names[k], blob: /** @type {Blob} */ ((await work.files(item, sentence))[1]) };
        }
      }
      const all = files();
      const table = this._table(new Map(items.map((item, k) => [item, names[k]])));
      const packed = await archiveOf((async function* () {
        yield* all;
        yield { name: "summary.csv", blob: table };
      })());
      saveBytes(packed, `${slug(sentence, 100) || "results"}.zip`);
      announce(`${counted(items.length, "result")} in a ZIP of ${bytes(packed.size)}`);
    });
    if (label) label.textContent = "Download ZIP";
    this._show();
  }

  /** What became of each file, also of those that have no result. @param {Map<Item, string>} names */
  _table(names) {
    const rows = this.items.map((item) => {
      const why = item.state(this.sentence) === "refused" ? item.why : item.failure;
      return [item.path, item.noun, this.sentence || item.job?.prompt || "", item.words(this.sentence), names.get(item) ?? "", item.job?.id ?? "", why ? [why.title, why.advice].filter(Boolean).join(" ") : ""];
    });
    return new Blob([[["file", "read as", "sentence", "state", "result", "job", "why"], ...rows].map(csvRow).join("\r\n") + "\r\n"], { type: "text/csv" });
  }
}
