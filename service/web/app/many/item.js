// @ts-check
/**
 * One file of many: what it was read as, what the sentence makes of it, and the job that keeps that. No elements here, so
 * that node can test it.
 *
 * @typedef {"waiting" | "reading" | "read" | "changing" | "changed" | "refused" | "sending" | "queued" | "running" | "canceling" | "succeeded" | "failed" | "canceled" | "expired"} State
 * @typedef {{title: string, advice: string}} Why
 */
import { isTerminal } from "../history.js";
import { STATE_WORDS, titled } from "../format.js";
import { withArticle } from "../vocabulary.js";

const WORDS = /** @type {Record<string, string>} */ ({ ...STATE_WORDS, waiting: "Waiting", reading: "Reading…", changing: "Changing…", changed: "Ready to keep", refused: "Not possible", sending: "Sending…", succeeded: "Kept" });

export class Item {
  /** @param {string} path Where the file lay. @param {import("../assets.js").Asset | null} asset Null: its job has it. @param {boolean} [sample] It is one of ours: read when there is something to change. */
  constructor(path, asset, sample = false) {
    this.sample = sample;
    this.path = path;
    this.asset = asset;
    /** @type {any} As `POST /v1/jobs:parts` has it. */
    this.reading = null;
    /** What a sentence makes of it, before it is kept. @type {{sentence: string, blob: Blob} | null} */
    this.made = null;
    /** @type {any} */
    this.job = null;
    /** @type {import("../../client/index.js").Verdict | null} */
    this.verdict = null;
    /** Why what was asked last did not come about, and of which sentence; that of the reading has none. @type {(Why & {sentence: string | null}) | null} */
    this.why = null;
    /** What is being done with it. @type {"" | "reading" | "changing" | "sending"} */
    this.doing = "";
    /** Whether its file has been drawn as it is. */
    this.drawn = asset === null;
    /** Whether pictures of its job's files are still to be drawn. */
    this.unseen = false;
  }

  /** @param {any} job That has kept it. */
  static of(job) {
    const item = new Item(job.metadata?.path || job.asset.filename, null);
    item.unseen = true;
    item.job = job;
    return item;
  }

  /** Whether its job makes what is asked. @param {string} sentence */
  keeps(sentence) {
    return this.job !== null && (!sentence || this.job.prompt === sentence);
  }

  /** Whether the result of what is asked is here. @param {string} sentence */
  has(sentence) {
    return this.made?.sentence === sentence;
  }

  /** @param {string} sentence That acts on all; empty: none does. @returns {State} */
  state(sentence) {
    const made = sentence !== "" && this.has(sentence);
    if (this.doing && !(made && this.doing === "reading")) return this.doing;
    if (this.keeps(sentence)) return this.job.state;
    if (made) return "changed";
    if (this.why && (this.why.sentence === null || this.why.sentence === sentence)) return "refused";
    if (sentence) return "waiting";
    return this.reading || this.sample ? "read" : "waiting";
  }

  /** What is to be done next without being asked. @param {string} sentence @returns {"" | "look" | "read" | "change"} */
  next(sentence) {
    if (this.doing || this.state(sentence) === "refused") return "";
    if (this.keeps(sentence)) return this.unseen && isTerminal(this.job.state) ? "look" : "";
    // What it was read as is told after what was asked for.
    if (sentence && !this.has(sentence)) return "change";
    return !this.reading && this.why?.sentence !== null && (sentence || !this.sample) ? "read" : "";
  }

  /** @param {string} sentence */
  words(sentence) {
    return WORDS[this.state(sentence)] ?? this.noun;
  }

  /** What it was read as, in words. */
  get noun() {
    if (!this.reading?.noun) return "";
    const { noun, sure, noun_given: given } = this.reading;
    return sure || given ? titled(withArticle(noun)) : `Perhaps ${withArticle(noun)}`;
  }

  /** What is wrong with its job; null: nothing. @returns {Why | null} */
  get failure() {
    if (!this.job || !isTerminal(this.job.state) || this.job.state === "succeeded") return null;
    const { detail, title, advice } = this.job.error ?? {};
    return { title: detail || title || `It was ${STATE_WORDS[this.job.state].toLowerCase()}.`, advice: advice ?? "" };
  }
}

/** "12 files: 9 ready to keep, 2 waiting, 1 not possible". @param {Item[]} items @param {string} sentence */
export function tally(items, sentence) {
  /** @type {Map<string, number>} */
  const counts = new Map();
  for (const item of items) {
    const words = item.state(sentence) === "read" ? (item.sample ? "samples" : "read") : item.words(sentence).replace("…", "").toLowerCase();
    counts.set(words, (counts.get(words) ?? 0) + 1);
  }
  return [...counts].map(([words, number]) => `${number} ${words}`).join(", ");
}

/** Names of the results in a ZIP, where the files lay, none of them twice. @param {string[]} paths */
export function resultNames(paths) {
  const used = new Set();
  return paths.map((path) => {
    const clean = path.split("/").filter((name) => name && name !== "." && name !== "..").join("/");
    const stem = clean.replace(/\.[^./]*$/, "");
    let name = `${stem}.glb`;
    for (let number = 2; used.has(name.toLowerCase()); number += 1) name = `${stem}-${number}.glb`;
    used.add(name.toLowerCase());
    return name;
  });
}

/** A row of a table as CSV. @param {(string | number)[]} cells */
export function csvRow(cells) {
  return cells.map((cell) => (/[",\n\r]/.test(String(cell)) ? `"${String(cell).replaceAll('"', '""')}"` : cell)).join(",");
}
