// @ts-check
/**
 * The request that a form means, and the form that a job means. The server checks every request again.
 *
 * @typedef {object} Field A number of a kind of job.
 * @property {string} name
 * @property {string} label
 * @property {string} help
 * @property {"integer" | "number"} type
 * @property {number} [min]
 * @property {number} [above] What it must be more than.
 * @property {number} [max]
 * @property {number} [standard] Its default.
 *
 * @typedef {object} Wish
 * @property {string} prompt
 * @property {string} model Empty: the server's default.
 * @property {string} preset
 * @property {number} seed
 * @property {boolean} subdivide
 * @property {string} [rig] What becomes of joints, morph targets and clips; empty: what the server does.
 * @property {string} [strength] How far a fit goes; empty: as the server has it.
 * @property {(import("./create/control/model.js").Control & {of?: string}) | null} [control] Regions, symmetry and corrections; `of` is the
 *   file that they are for.
 * @property {boolean} [byShape] Whether the asset is fitted to the shape that its prompt stands for, instead of pushed by a model.
 * @property {(import("./create/guide/model.js").Guide & {targets?: number}) | null} [guide] What its files besides the asset are for.
 * @property {Kept} kept What a job that is asked for again had and the form has no field for.
 *
 * @typedef {object} Kept
 * @property {Record<string, any>} params
 * @property {Record<string, any>} output
 */

import { CONTROL_PARAMS, controlOf, controlParams, noControl } from "./create/control/model.js";
import { EXEMPLAR, GUIDE_PARAMS, guideOf, guideParams, isTarget, noGuide } from "./create/guide/model.js";
import { count, titled } from "./format.js";
import { groupedParams, plainParams } from "./groups.js";

export const PRESETS = /** @type {[string, string, string][]} */ ([
  ["preview", "Preview", "A quick first look"],
  ["balanced", "Balanced", "A finished shape"],
  ["paper", "Paper", "As published: 5,000 steps"],
]);
/** As the API and the command line have it. */
export const USUAL_PRESET = "balanced";
export const MAX_SEED = Number.MAX_SAFE_INTEGER;

/**
 * All parameters of a kind of job that are numbers, as `GET /v1/limits` declares them, each with its default.
 * @param {any} schema The JSON schema of the kind's parameters.
 * @returns {Field[]}
 */
export function numbersOf(schema) {
  const numbers = Object.entries(schema?.properties ?? {}).filter(([, member]) => member.type === "integer" || member.type === "number");
  return numbers.map(([name, member]) => {
    return { name, label: titled(name), help: (member.description ?? "").replaceAll("`", ""), type: member.type, min: member.minimum, above: member.exclusiveMinimum, max: member.maximum, standard: member.default };
  });
}

/** What is wrong with what was typed; empty where it is fine or empty. @param {Field} field @param {string} text */
export function fieldProblem(field, text) {
  const value = text.trim();
  if (value === "") return "";
  const number = Number(value);
  if (!Number.isFinite(number)) return "Enter a number.";
  if (field.type === "integer" && !Number.isInteger(number)) return "Enter a whole number.";
  if (field.min !== undefined && number < field.min) return `At least ${count(field.min)}.`;
  if (field.above !== undefined && number <= field.above) return `More than ${count(field.above)}.`;
  if (field.max !== undefined && number > field.max) return `At most ${count(field.max)}.`;
  return "";
}

/** What is wrong with a whole number that has to be there; empty where it is fine. @param {string} text @param {number} min @param {number} max */
export function integerProblem(text, min, max) {
  const value = text.trim();
  if (!/^[+-]?\d+$/.test(value)) return `Enter a whole number from ${count(min)} to ${count(max)}.`;
  if (Number(value) < min) return `At least ${count(min)}.`;
  return Number(value) > max ? `At most ${count(max)}.` : "";
}

/**
 * The document to post.
 * @param {Wish} wish
 * @param {number | null} steps What the server says the steps will be; null where it has not yet.
 * @param {import("./groups.js").Groups} groups In which a request has them.
 * @returns {Record<string, any>}
 */
export function documentOf(wish, steps, groups) {
  const targets = wish.guide?.targets ?? 0;
  const prompt = wish.prompt.trim();
  /** @type {Record<string, any>} */
  const params = { ...wish.kept.params, ...controlParams(wish.control ?? noControl()), ...guideParams(wish.guide ?? noGuide(), targets, prompt, wish.byShape), preset: wish.preset, seed: wish.seed };
  if (wish.model) params.model = wish.model;
  if (wish.strength) params.strength = Number(wish.strength);
  const planned = params.steps ?? steps;
  if (planned) params.checkpoint_every_steps = checkpointEvery(planned);
  return {
    // A target mesh takes the place of a prompt.
    ...(targets || ((params.guidance || params.prompts) && !prompt) ? {} : { prompt }),
    params: groupedParams(params, groups),
    output: { ...wish.kept.output, ...(wish.subdivide ? { subdivide: true } : {}), ...(wish.rig ? { rig: wish.rig } : {}) },
  };
}

/** Whether a job fits its asset to a shape, and asks no model. @param {any} job */
export function isByShape(job) {
  return plainParams(job.params).guidance === EXEMPLAR;
}

/** Ten shapes on the way to the last one. @param {number} steps */
export function checkpointEvery(steps) {
  return Math.max(1, Math.round(steps / 10));
}

/** @param {() => number} [random] In [0, 1). */
export function randomSeed(random = Math.random) {
  return Math.floor(random() * 100000);
}

// Not kept: what the form asks for itself, and the words, which the server pins anew.
const ASKED = ["preset", "model", "words", "seed", "strength", "checkpoint_every_steps", ...GUIDE_PARAMS, ...CONTROL_PARAMS];

/** Nothing kept. @returns {Kept} */
export function nothingKept() {
  return { params: {}, output: {} };
}

/** What is kept, in words; empty where it is nothing. @param {Kept} kept */
export function keptText(kept) {
  const named = [...Object.entries(kept.params), ...Object.entries(kept.output).map(([name, value]) => [`output.${name}`, value])];
  return named.map(([name, value]) => `${name} ${typeof value === "object" ? JSON.stringify(value) : value}`).join(", ");
}

/**
 * What a form must hold to ask for a job again.
 * @param {any} job
 * @param {Record<string, any>} [defaults] Of `output`: what a job has anyway needs no keeping.
 * @returns {Wish}
 */
export function wishOf(job, defaults = {}) {
  const params = plainParams(job.params);
  return {
    prompt: String(job.prompt ?? ""),
    model: String(params.model ?? ""),
    preset: String(params.preset ?? USUAL_PRESET),
    seed: Number(params.seed ?? 0),
    subdivide: Boolean(job.output?.subdivide),
    rig: job.output?.rig ?? "",
    strength: String(params.strength ?? ""),
    byShape: isByShape(job),
    guide: { ...guideOf(params), targets: Object.keys(job.files ?? {}).filter(isTarget).length },
    control: { ...controlOf(params), of: job.asset ? fileKey(job.asset.filename, job.asset.size) : "" },
    kept: {
      params: Object.fromEntries(Object.entries(params).filter(([name]) => !ASKED.includes(name))),
      output: Object.fromEntries(Object.entries(job.output ?? {}).filter(([name, value]) => !["subdivide", "rig"].includes(name) && value && !same(value, defaults[name]))),
    },
  };
}

/** What a job says for one on its result: how it was made, and not what. What was fitted to a target or pictures goes on by shape. @param {any} job */
export function continued(job) {
  const { model, preset, orientation, guidance } = plainParams(job.params);
  const params = Object.entries({ model, preset, orientation, guidance: guidance && EXEMPLAR }).filter(([, value]) => value !== undefined);
  return { ...job, prompt: "", params: Object.fromEntries(params), output: {}, files: {} };
}

/** What tells one file from another on the form. @param {string} name @param {number} size */
export function fileKey(name, size) {
  return `${name} ${size}`;
}

/** Return whether two values are alike, in whatever order their members are. @param {any} a @param {any} b */
function same(a, b) {
  const sorted = (/** @type {any} */ value) => JSON.stringify(value && typeof value === "object" ? Object.entries(value).sort() : value);
  return sorted(a) === sorted(b);
}
