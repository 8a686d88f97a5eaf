// @ts-check
/** Which faces the regions of a request select, and which of them do not move. No WebGL here, so that node can test it. */
/** @typedef {import("./surface.js").NumberedSurface} Surface */
/** @typedef {Record<string, any>} Region as in `params.regions` of a request */

/** The server's bound on `faces`. */
export const MOST_RANGES = 20_000;

/**
 * @param {Region} region
 * @param {Pick<Surface, "count" | "rest" | "corners">} surface
 * @returns {Uint8Array | null} (F) 1 where it selects the face; null where only the service can tell
 */
export function selectedFaces({ faces, box }, surface) {
  const flags = new Uint8Array(surface.count);
  if (faces) {
    for (const [first, last] of faces.map((/** @type {any} */ item) => (Array.isArray(item) ? item : [item, item]))) flags.fill(1, first, last + 1);
    return flags;
  }
  if (!box) return null;
  const inside = (/** @type {number} */ v) => [0, 1, 2].every((axis) => surface.rest[3 * v + axis] >= box.min[axis] && surface.rest[3 * v + axis] <= box.max[axis]);
  return flags.map((_, f) => Number([0, 1, 2].every((corner) => inside(surface.corners[3 * f + corner]))));
}

/** The faces of any of several selections. @param {(Uint8Array | null)[]} flags null: what only the service can tell @param {number} count of faces @returns {Uint8Array} (F) */
export function unionOf(flags, count) {
  return new Uint8Array(count).map((_, f) => Number(flags.some((region) => region?.[f])));
}

/**
 * The faces that do not move: those that a region keeps, and where regions say `only`, all outside of them.
 * @param {{ action?: string, flags: Uint8Array | null }[]} regions
 * @param {number} count of faces
 * @returns {Uint8Array} (F); what only the service can tell is left out
 */
export function keptFaces(regions, count) {
  const known = regions.filter(({ flags }) => flags);
  const only = known.filter(({ action }) => action === "only");
  // Where one `only` is not known, what lies outside of the others may still be in it.
  const outside = only.length > 0 && only.length === regions.filter(({ action }) => action === "only").length;
  const kept = new Uint8Array(count).fill(outside ? 1 : 0);
  if (outside) for (const { flags } of only) flags?.forEach((on, f) => on && (kept[f] = 0));
  for (const { action, flags } of known) if (action !== "only") flags?.forEach((on, f) => on && (kept[f] = 1));
  return kept;
}

/** @param {Uint8Array} flags (F) @returns {(number | [number, number])[]} as `faces` has them: numbers, and ranges with both ends */
export function rangesOf(flags) {
  /** @type {(number | [number, number])[]} */
  const found = [];
  for (let first = 0; first < flags.length; first++) {
    if (!flags[first]) continue;
    let last = first;
    while (flags[last + 1]) last++;
    found.push(first === last ? first : [first, last]);
    first = last;
  }
  return found;
}

/** The corners at each vertex, one list after the other. @param {Uint32Array} indices @param {number} count */
function facesAround(indices, count) {
  const starts = new Uint32Array(count + 1);
  for (const vertex of indices) starts[vertex + 1]++;
  for (let v = 0; v < count; v++) starts[v + 1] += starts[v];
  const around = new Uint32Array(indices.length);
  const next = starts.slice();
  indices.forEach((vertex, corner) => (around[next[vertex]++] = corner));
  return { starts, around };
}

/** Who touches whom on a surface, for a brush that stays on it. */
export class Neighbours {
  /** @param {Pick<Surface, "corners" | "groups" | "shown">} surface */
  constructor({ corners, groups, shown }) {
    this.corners = Uint32Array.from(corners, (corner) => groups[corner]);
    this.shown = shown;
    const { starts, around } = facesAround(this.corners, groups.length);
    this.starts = starts;
    this.faces = around.map((corner) => Math.floor(corner / 3));
  }

  /**
   * The faces around a point of the surface: the one that it is on, and those joined to it whose middle is near enough.
   * @param {number} face
   * @param {[number, number, number]} point
   * @param {number} radius
   * @returns {number[]}
   */
  around(face, point, radius) {
    const found = [face];
    const seen = new Set(found);
    for (const near of found) {
      for (let c = 3 * near; c < 3 * near + 3; c++) {
        const at = this.corners[c];
        for (let i = this.starts[at]; i < this.starts[at + 1]; i++) {
          const next = this.faces[i];
          if (seen.has(next)) continue;
          seen.add(next);
          if (this.#distance(next, point) <= radius) found.push(next);
        }
      }
    }
    return found;
  }

  /** @param {number} face @param {[number, number, number]} point @returns {number} from the face's middle */
  #distance(face, point) {
    const [a, b, c] = this.corners.subarray(3 * face, 3 * face + 3);
    const off = (/** @type {number} */ axis) => (this.shown[3 * a + axis] + this.shown[3 * b + axis] + this.shown[3 * c + axis]) / 3 - point[axis];
    return Math.hypot(off(0), off(1), off(2));
  }
}
