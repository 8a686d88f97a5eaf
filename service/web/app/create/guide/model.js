// @ts-check
/**
 * What else than a prompt says what the asset should become: another mesh, the nearest of several, or pictures from one
 * to four sides.
 * No elements here, so that node can test it.
 *
 * @typedef {import("../../assets.js").Asset} Asset
 * @typedef {{azimuth: number, elevation: number, fov?: number}} Direction
 * @typedef {object} Guide
 * @property {Direction[]} pictures The directions, in the order of the files.
 */

export const MOST_PICTURES = 4;
/** The guidance that fits the asset to a shape. */
export const EXEMPLAR = "exemplar";
/** The parameters that the panel edits. */
export const GUIDE_PARAMS = ["silhouettes", "guidance"];
/** Those of a job that hold for its own target alone. */
export const TARGET_PARAMS = ["align", "landmarks"];

/** @returns {Guide} */
export function noGuide() {
  return { pictures: [] };
}

/**
 * The files of a job that its guide needs, by their names in it.
 * @template T
 * @param {T[]} targets
 * @param {T[]} pictures
 * @returns {Record<string, T>}
 */
export function guideFiles(targets, pictures) {
  if (targets.length) return Object.fromEntries(targets.map((file, i) => [i ? `target_${i + 1}` : "target", file]));
  return Object.fromEntries(pictures.map((file, i) => [`silhouette_${i + 1}`, file]));
}

/** Whether a file of a job is a target mesh. @param {string} name Of the file in the job. */
export function isTarget(name) {
  return /^target(_\d)?$/.test(name);
}

/**
 * The targets among the files of a job, the first one first.
 * @template T
 * @param {Record<string, T>} files By their names in the job.
 * @returns {T[]}
 */
export function targetsOf(files) {
  return Object.keys(files).filter(isTarget).sort().map((name) => files[name]);
}

/**
 * The parameters of a request.
 * @param {Guide} guide
 * @param {number} targets How many target meshes there are.
 * @param {string} prompt
 * @param {boolean} [byShape] Whether the asset is fitted to a shape. Of several targets, it always is to the nearest.
 * @returns {Record<string, any>}
 */
export function guideParams({ pictures }, targets, prompt, byShape = false) {
  if (targets) return { guidance: byShape || targets > 1 ? EXEMPLAR : "target" };
  const silhouettes = pictures.length ? { silhouettes: pictures } : {};
  if (!prompt && pictures.length) return { guidance: "silhouettes", ...silhouettes };
  return { ...(byShape ? { guidance: EXEMPLAR } : {}), ...silhouettes };
}

/** @param {Record<string, any>} params Of a job. @returns {Guide} */
export function guideOf({ silhouettes }) {
  const pictures = (silhouettes ?? []).map((/** @type {any} */ view) => ({ elevation: 0, ...view }));
  return structuredClone({ pictures });
}

/** An angle from -180 to 180 degrees. @param {number} degrees */
export function wrapped(degrees) {
  const turned = ((degrees % 360) + 360) % 360;
  return turned > 180 ? turned - 360 : turned;
}

/** What cannot be sent, in a sentence; empty where all is fine. @param {Guide} guide */
export function guideProblem({ pictures }) {
  const same = pictures.findIndex((one, i) => pictures.slice(0, i).some((other) => Math.abs(wrapped(one.azimuth - other.azimuth)) < 1 && Math.abs(one.elevation - other.elevation) < 1));
  return same < 0 ? "" : `Picture ${same + 1} has the direction of another one.`;
}
