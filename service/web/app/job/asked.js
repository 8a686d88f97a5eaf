// @ts-check
/** What a job was asked to keep and to hold, in words. */
import { controlOf, controlWords } from "../create/control/model.js";
import { h, panel } from "../dom.js";
import { targetsOf } from "../create/guide/model.js";
import { counted, percent } from "../format.js";
import { plainParams } from "../groups.js";
import { isByShape } from "../params.js";

/** @param {any} job @returns {HTMLElement | null} null where nothing was asked */
export function askedPanel(job) {
  const words = [...guideWords(job), ...controlWords(controlOf(plainParams(job.params)))];
  if (!words.length) return null;
  return panel("asked-title", "Control", h("ul", { class: "asked" }, words.map((text) => h("li", null, text))));
}

/** @param {any} job @returns {string[]} what guides it besides its prompt */
function guideWords({ files = {}, ...job }) {
  const params = plainParams(job.params);
  const shape = isByShape(job) && params.strength !== undefined ? [`Strength: ${percent(params.strength)}`] : [];
  const targets = targetsOf(files).map(({ filename }) => `Target: ${filename}`);
  const pairs = params.landmarks?.length ? [counted(params.landmarks.length, "pair of points", "pairs of points")] : [];
  const pictures = (params.silhouettes ?? []).map((/** @type {any} */ view, /** @type {number} */ i) => `Picture: ${files[`silhouette_${i + 1}`]?.filename ?? i + 1}, from ${view.azimuth}°${view.elevation ? `, ${view.elevation}° up` : ""}`);
  return [...shape, ...targets, ...pairs, ...pictures];
}
