// @ts-check
/**
 * What is asked of the parts of an asset, as the sentence that a prompt says it with: "legs longer by 30 %".
 *
 * @typedef {{operation: string, more: string, less: string}} Change
 * @typedef {{name: string, found_by: string, confidence?: number | null, faces: (number | number[])[], changes: Change[]}} Part
 * @typedef {{part: string, change: Change, percent: number}} Wanted
 */

/** The least and the most that a slider asks for, in percent. */
export const LEAST = -50;
export const MOST = 100;

/** @param {Wanted} wanted @returns {string} */
export function clause({ part, change, percent }) {
  return `${part} ${percent < 0 ? change.less : change.more} by ${Math.abs(percent)} %`;
}

/** @param {Wanted[]} wanted @returns {string} empty where nothing is */
export function sentenceOf(wanted) {
  return wanted.map(clause).join(" and ");
}

/** The same wishes with another amount of one of them; none of it takes it away. @param {Wanted[]} wanted @param {Wanted} one @returns {Wanted[]} */
export function withWanted(wanted, one) {
  const at = wanted.findIndex((other) => other.part === one.part && other.change.operation === one.change.operation);
  const kept = wanted.filter((_, i) => i !== at);
  if (one.percent === 0) return kept;
  return at < 0 ? [...kept, one] : wanted.with(at, one);
}

/**
 * The part that is meant by a triangle: the smallest that was not only found by a name, such as that of a material, or
 * else the smallest.
 * @param {Part[]} parts
 * @param {number} face
 * @returns {Part | null}
 */
export function partAt(parts, face) {
  const holds = parts.filter(({ faces }) => faces.some((item) => (typeof item === "number" ? item === face : face >= item[0] && face <= item[1])));
  const own = holds.filter(({ found_by: by }) => by !== "names");
  const [found] = (own.length ? own : holds).sort((a, b) => sizeOf(a) - sizeOf(b));
  return found ?? null;
}

/** @param {Part} part @returns {number} of triangles */
export function sizeOf({ faces }) {
  return faces.reduce((/** @type {number} */ sum, item) => sum + (typeof item === "number" ? 1 : item[1] - item[0] + 1), 0);
}
