// @ts-check
/** Numbers, times and words as people read them. */
import { EXEMPLAR } from "./create/guide/model.js";
import { plainParams } from "./groups.js";

const INTEGER = new Intl.NumberFormat("en");

/** @param {number} value */
export function count(value) {
  return INTEGER.format(value);
}

/** "1 triangle", "5,120 triangles". @param {number} value @param {string} singular @param {string} [plural] */
export function counted(value, singular, plural = singular + "s") {
  return `${count(value)} ${value === 1 ? singular : plural}`;
}

/** The name of a parameter or a part, as a label. @param {string} name Such as `back_height`. */
export function titled(name) {
  return name.slice(0, 1).toUpperCase() + name.slice(1).replaceAll("_", " ");
}

/** @param {number} value Bytes. */
export function bytes(value) {
  if (value < 1000) return `${value} B`;
  const units = ["kB", "MB", "GB", "TB"];
  let scaled = value / 1000;
  let unit = 0;
  // What would round to 1,000 belongs to the next unit.
  while (scaled >= 999.5 && unit < units.length - 1) {
    scaled /= 1000;
    unit += 1;
  }
  return `${scaled < 9.95 ? scaled.toFixed(1) : Math.round(scaled)} ${units[unit]}`;
}

/** "8 s", "2 min 5 s", "3 h 12 min". @param {number} seconds */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds < 0.95) return "under 1 s";
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return whole % 60 ? `${Math.floor(whole / 60)} min ${whole % 60} s` : `${whole / 60} min`;
  const minutes = Math.round(whole / 60);
  const hours = Math.floor(minutes / 60);
  if (hours < 48) return minutes % 60 ? `${hours} h ${minutes % 60} min` : `${hours} h`;
  return counted(Math.round(hours / 24), "day");
}

/** A rounded duration, for estimates. @param {number} seconds */
export function roughly(seconds) {
  if (seconds < 1) return "a second";
  if (seconds < 10) return duration(seconds);
  if (seconds < 60) return duration(Math.round(seconds / 5) * 5);
  if (seconds < 600) return duration(Math.round(seconds / 30) * 30);
  return duration(Math.round(seconds / 60) * 60);
}

/** "just now", "4 min ago", "2 days ago". @param {string} time ISO 8601. @param {number} [now] Milliseconds. */
export function ago(time, now = Date.now()) {
  const seconds = (now - Date.parse(time)) / 1000;
  if (!Number.isFinite(seconds)) return "";
  if (seconds < 45) return "just now";
  if (seconds < 3600) return `${Math.max(1, Math.round(seconds / 60))} min ago`;
  if (seconds < 86400) return `${Math.round(seconds / 3600)} h ago`;
  return `${counted(Math.round(seconds / 86400), "day")} ago`;
}

/** Four significant digits at most, without a tail of zeros. @param {number} value */
export function figure(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 0.001 || size >= 1e6)) return value.toExponential(1).replace("e+", "e");
  return INTEGER.format(Number(value.toPrecision(3)));
}

/** @param {number} fraction In [0, 1]. */
export function percent(fraction) {
  return `${Math.floor(100 * Math.min(1, Math.max(0, fraction)) + 1e-9)}%`;
}

export const STATE_WORDS = /** @type {Record<string, string>} */ ({
  queued: "Queued",
  running: "Running",
  canceling: "Canceling",
  succeeded: "Succeeded",
  failed: "Failed",
  canceled: "Canceled",
  expired: "Expired",
});

const PHASES = /** @type {Record<string, string>} */ ({
  queued: "Waiting for a worker",
  fetching: "Fetching the file",
  loading: "Loading the model",
  preparing: "Preparing the mesh",
  optimizing: "Deforming",
  writing: "Writing the file",
  uploading: "Storing the results",
  done: "Done",
});

/** The goals of a job in words: its prompts; empty: a target mesh. @param {any} job */
export function goalWords(job) {
  // Another version may write all else in its own way.
  if (job.unreadable) return String(job.prompt ?? "");
  const prompts = [job.prompt, ...(plainParams(job.params).prompts ?? []).map((/** @type {any} */ each) => each.prompt)].filter(Boolean);
  return prompts.join(" + ");
}

const KIND_TITLES = /** @type {Record<string, string>} */ ({
  surface_fit: "Surface fit",
  family_fit: "Family of shapes",
  family_synthesize: "New shapes of a family",
  prior_teach: "A lesson", // of older versions
});

/** What stands for a job in lists: its goals in words, else what it does. @param {any} job */
export function jobTitle(job) {
  const goal = goalWords(job);
  const kind = job.kind ?? "text_deform";
  if (goal) return goal;
  if (job.unreadable || kind !== "text_deform") return KIND_TITLES[kind] ?? kind.replaceAll("_", " ");
  if (job.files?.target_2) return "To the nearest of several meshes";
  return job.files?.target ? "To a target mesh" : "To pictures";
}

/** @param {string} phase */
export function phaseWords(phase) {
  return PHASES[phase] ?? titled(phase);
}

/** How long a job would take, in words. @param {any} found What `POST /v1/jobs:validate` says. */
export function estimateWords(found) {
  const { queue_s: queue, run_s: run, steps: planned } = found.estimate;
  const work = found.params.guidance === EXEMPLAR ? "A fit" : `${count(planned)} steps`;
  const steps = planned ? work : "A change in plain words";
  if (run === null) return `${steps}. No estimate yet: no job like this has run here.`;
  const wait = queue && queue > 1 ? `, after about ${duration(Math.round(queue))} in the queue` : "";
  return `${steps}, about ${roughly(run)}${wait}.`;
}

/** A word of the shell, quoted where it must be. @param {string} text */
export function quoted(text) {
  return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", `'\\''`)}'`;
}
