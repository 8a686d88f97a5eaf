// @ts-check
/**
 * What the product reads an asset as, in words. No elements here, so that node can test it.
 *
 * @typedef {object} Reading As `POST /v1/jobs:parts` has it.
 * @property {string} noun
 * @property {number} probability
 * @property {boolean} sure
 * @property {{noun: string, probability: number}[]} nouns The most probable first.
 * @property {boolean} noun_given
 * @property {number | null} front_azimuth_deg
 * @property {boolean} front_sure
 * @property {boolean} front_given
 */
import { percent, titled } from "../../format.js";
import { withArticle } from "../../vocabulary.js";

/** What a menu has to type a noun. */
export const ELSE = "else";
/** Less confident ones are shown as a guess. */
const SURE = 0.5;
const SIDES = /** @type {[string, string][]} */ ([["0", "+Z, as in the file"], ["45", "between +Z and +X"], ["90", "+X, the left side"], ["135", "between +X and −Z"], ["180", "−Z, the back"], ["225", "between −Z and −X"], ["270", "−X, the right side"], ["315", "between −X and +Z"]]);

/** @param {number} degrees From +Z towards +X. */
function sideName(degrees) {
  const angle = ((Math.round(degrees) % 360) + 360) % 360;
  return SIDES.find(([side]) => Number(side) === angle)?.[1].split(",")[0] ?? `${angle}°`;
}

const SEEN = /** @type {[number, string][]} */ ([[0, "you"], [90, "right"], [180, "away"], [270, "left"], [360, "you"]]);

/** What an asset is read as, in a sentence that the names of its parts end. @param {Reading} reading @param {number} parts How many. */
export function readingSentence(reading, parts) {
  const sure = reading.sure || reading.noun_given;
  const { front_azimuth_deg: front } = reading;
  const angle = front === null ? null : ((front % 360) + 360) % 360;
  const side = angle === null ? "" : SEEN.reduce((best, each) => (Math.abs(each[0] - angle) < Math.abs(best[0] - angle) ? each : best))[1];
  return `${sure ? "Read as" : "Perhaps"} ${withArticle(reading.noun)}${side ? `, ${isFrontSure(reading) ? "" : "perhaps "}facing ${side}` : ""}${parts ? ". Its parts:" : "."}`;
}

/** Whether the front is more than a guess: that of a guessed noun is one. @param {Reading} reading */
function isFrontSure({ sure, noun_given: given, front_sure, front_given }) {
  return front_given || (front_sure && (sure || given));
}

/** What stands before the noun, empty where it is sure, and before the front. @param {Reading} reading @param {boolean} fronted Whether somebody said the front. @returns {[string, string]} */
export function doubts(reading, fronted) {
  const article = withArticle(reading.noun).split(" ")[0];
  return [reading.sure || reading.noun_given ? "" : `Perhaps ${article}`, fronted || isFrontSure(reading) ? "faces" : "perhaps faces"];
}

/** The nouns to choose from: values, of which the empty one is as it was read, and words. @param {Reading} reading @param {string} said By a person; empty: nothing. @returns {[string, string][]} */
export function nounOptions({ noun, probability, sure, nouns, noun_given: given }, said) {
  const others = nouns.filter((each) => each.noun !== (said || noun)).map((each) => /** @type {[string, string]} */ ([each.noun, `${each.noun}, ${percent(each.probability)}`]));
  /** @type {[string, string][]} */
  const read = said ? [[said, `${titled(said)}, as you said`]] : [["", sure || given ? titled(noun) : `${noun}, ${percent(probability)}`]];
  return [...read, ...(said || sure ? [] : [/** @type {[string, string]} */ ([noun, `Yes, ${withArticle(noun)}`])]), ...others, ...(said ? [/** @type {[string, string]} */ (["", "As it was read"])] : []), [ELSE, "Something else…"]];
}

/** The fronts to choose from, likewise. @param {Reading} reading @param {string} said In degrees, or empty. @returns {[string, string][]} */
export function frontOptions({ front_azimuth_deg: front }, said) {
  const own = said && !SIDES.some(([side]) => side === said) ? [[said, Number.isFinite(Number(said)) ? `${said}°` : said]] : [];
  const read = said ? "As it was read" : front === null ? "no side that is the front" : sideName(front);
  return /** @type {[string, string][]} */ ([["", read], ...SIDES, ...own]);
}

/** The noun by whose shapes a part was found, where it is rather another one; empty: it is not. @param {import("./sentence.js").Part} part @param {Reading | null} reading */
function guessedNoun({ found_by: by }, reading) {
  return by === "shapes" && reading && !reading.noun_given && reading.probability < SURE ? reading.noun : "";
}

/** Whether a part is a guess. @param {import("./sentence.js").Part} part @param {Reading | null} reading */
export function isUnsure(part, reading) {
  return guessedNoun(part, reading) !== "" || (typeof part.confidence === "number" && part.confidence < SURE);
}

/** How a part was found, in a sentence. @param {import("./sentence.js").Part} part @param {Reading | null} reading @param {boolean} said Whether the form says something of it. */
export function originWords(part, reading, said) {
  if (part.found_by === "given") return said ? "As you said." : "As the file says.";
  if (part.found_by === "joints") return "By the joints of the file.";
  if (part.found_by === "names") return "By a name in the file.";
  const share = typeof part.confidence === "number" ? `, ${percent(part.confidence)} sure` : "";
  const noun = guessedNoun(part, reading);
  const found = isUnsure(part, null) ? "Perhaps found" : "Found";
  return `${noun ? `If it is ${withArticle(noun)}: ${found.toLowerCase()}` : found} by its shape${share}.`;
}
