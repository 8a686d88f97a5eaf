// @ts-check
/**
 * What else than a prompt says what the asset should become: another mesh, or pictures from one to four sides.
 * No elements here, so that node can test it.
 *
 * @typedef {import("../../assets.js").Asset} Asset
 * @typedef {{source: number[] | number, target: number[] | number}} Landmark
 * @typedef {{azimuth: number, elevation: number, fov?: number}} Direction
 * @typedef {object} Guide
 * @property {string} align Empty: as the service decides.
 * @property {Landmark[]} landmarks
 * @property {Direction[]} pictures The directions, in the order of the files.
 */

export const MOST_PICTURES = 4;
/** The parameters that the panel edits. */
export const GUIDE_PARAMS = ["align", "landmarks", "silhouettes", "guidance"];

/** @returns {Guide} */
export function noGuide() {
  return { align: "", landmarks: [], pictures: [] };
}

/**
 * The parts of a job that its guide needs, by name.
 * @template T
 * @param {T | null} target
 * @param {T[]} pictures
 * @returns {Record<string, T>}
 */
export function guideFiles(target, pictures) {
  if (target) return { target };
  return Object.fromEntries(pictures.map((file, i) => [`silhouette_${i + 1}`, file]));
}

/**
 * The parameters of a request.
 * @param {Guide} guide
 * @param {boolean} target Whether there is a target mesh.
 * @param {string} prompt
 * @returns {Record<string, any>}
 */
export function guideParams({ align, landmarks, pictures }, target, prompt) {
  if (target) {
    return {
      guidance: "target",
      ...(align ? { align } : {}),
      ...(landmarks.length ? { landmarks } : {}),
    };
  }
  return pictures.length ? { ...(prompt ? {} : { guidance: "silhouettes" }), silhouettes: pictures } : {};
}

/** @param {Record<string, any>} params Of a job. @returns {Guide} */
export function guideOf({ align, landmarks, silhouettes }) {
  const pictures = (silhouettes ?? []).map((/** @type {any} */ view) => ({ elevation: 0, ...view }));
  return structuredClone({ align: align ?? "", landmarks: landmarks ?? [], pictures });
}

/** An angle from -180 to 180 degrees. @param {number} degrees */
export function wrapped(degrees) {
  const turned = ((degrees % 360) + 360) % 360;
  return turned > 180 ? turned - 360 : turned;
}

/** What cannot be sent, in a sentence; empty where all is fine. @param {Guide} guide */
export function guideProblem({ pictures }) {
  if (pictures.some(({ azimuth, elevation }) => !(Math.abs(azimuth) <= 360 && Math.abs(elevation) <= 90))) return "An azimuth is at most 360 degrees, an elevation at most 90.";
  const same = pictures.findIndex((one, i) => pictures.slice(0, i).some((other) => Math.abs(wrapped(one.azimuth - other.azimuth)) < 1 && Math.abs(one.elevation - other.elevation) < 1));
  return same < 0 ? "" : `Picture ${same + 1} has the direction of another one.`;
}
