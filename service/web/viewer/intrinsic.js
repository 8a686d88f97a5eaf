// @ts-check
/**
 * An intrinsic Delaunay triangulation of a manifold mesh: faces and side lengths. The counterpart in Python is
 * `meshdeform/kinds/surface_fit/intrinsic.py`; a test compares the two. Side k of a face runs from its corner k to corner k + 1, and
 * a half-edge is the number 3 face + k.
 *
 * Source: Bobenko and Springborn 2007; Fisher et al. 2007.
 *
 * @typedef {object} Intrinsic
 * @property {Uint32Array} faces (3F)
 * @property {Float64Array} lengths (3F)
 * @property {number} vertices
 * @property {number} flips
 */

const TOLERANCE = 1e-9;

/** @param {Float32Array} positions (3V) @param {Uint32Array} indices (3F) with at most two faces at an edge @returns {Intrinsic} */
export function delaunay(positions, indices) {
  const faces = indices.slice();
  const count = faces.length;
  const lengths = new Float64Array(count);
  for (let e = 0; e < count; e++) {
    const [a, b] = [3 * faces[e], 3 * faces[follow(e)]];
    lengths[e] = Math.hypot(positions[a] - positions[b], positions[a + 1] - positions[b + 1], positions[a + 2] - positions[b + 2]);
  }
  lengthen(lengths);
  const vertices = positions.length / 3;
  const twin = twinsOf(faces, vertices);
  return { faces, lengths, vertices, flips: flipAll(faces, lengths, twin) };
}

/** @param {number} e @returns {number} the half-edge after it in its face */
function follow(e) {
  return e % 3 === 2 ? e - 2 : e + 1;
}

/** Lengthen all sides alike where rounding breaks a triangle's inequality (Sharp and Crane 2020). @param {Float64Array} lengths */
function lengthen(lengths) {
  const least = 1e-6 * lengths.slice().sort()[lengths.length >> 1];
  let more = 0;
  for (let f = 0; f < lengths.length; f += 3) {
    const sum = lengths[f] + lengths[f + 1] + lengths[f + 2];
    for (let k = f; k < f + 3; k++) more = Math.max(more, least - (sum - 2 * lengths[k]));
  }
  if (more > 0) for (let e = 0; e < lengths.length; e++) lengths[e] += more;
}

/** @param {Uint32Array} faces @param {number} vertices @returns {Int32Array} (3F) the half-edge at the other side; -1 at a border */
function twinsOf(faces, vertices) {
  const twin = new Int32Array(faces.length).fill(-1);
  /** @type {Map<number, number>} */
  const open = new Map();
  for (let e = 0; e < faces.length; e++) {
    const [a, b] = [faces[e], faces[follow(e)]];
    const found = open.get(b * vertices + a);
    if (found === undefined) open.set(a * vertices + b, e);
    else {
      open.delete(b * vertices + a);
      twin[e] = found;
      twin[found] = e;
    }
  }
  return twin;
}

/** @param {Float64Array} sides @param {number} e @returns {number} cotangent of the angle opposite to a half-edge */
function cotangent(sides, e) {
  const next = follow(e);
  const [a, b, c] = [sides[e], sides[next], sides[follow(next)]];
  const inside = (a + b + c) * (b + c - a) * (a + c - b) * (a + b - c);
  return (b * b + c * c - a * a) / Math.sqrt(Math.max(inside, 1e-300));
}

/** Flip until every inner edge is Delaunay. @param {Uint32Array} faces @param {Float64Array} sides @param {Int32Array} twin @returns {number} of flips */
function flipAll(faces, sides, twin) {
  const waiting = new Uint8Array(faces.length).fill(1);
  const queue = Array.from({ length: faces.length }, (_, e) => e);
  let flips = 0;
  while (queue.length) {
    const e = /** @type {number} */ (queue.pop());
    waiting[e] = 0;
    const t = twin[e];
    const [f, g] = [e - (e % 3), t - (t % 3)];
    if (t < 0 || f === g || cotangent(sides, e) + cotangent(sides, t) >= -TOLERANCE) continue;
    const [e1, t1] = [follow(e), follow(t)];
    const [e2, t2] = [follow(e1), follow(t1)];
    // Unfold: the edge on the x axis from (0, 0), one tip above, one below.
    const [base, la, lb, lc, ld] = [sides[e], sides[e1], sides[e2], sides[t1], sides[t2]];
    const x1 = (base * base + lb * lb - la * la) / (2 * base);
    const x2 = (base * base + lc * lc - ld * ld) / (2 * base);
    const [y1, y2] = [Math.sqrt(Math.max(lb * lb - x1 * x1, 0)), Math.sqrt(Math.max(lc * lc - x2 * x2, 0))];
    const crossing = (x1 * y2 + x2 * y1) / Math.max(y1 + y2, 1e-300);
    if (crossing <= 0 || crossing >= base) continue; // rounding: the diagonals do not cross
    const length = Math.hypot(x1 - x2, y1 + y2);
    const [a, b, c, d] = [faces[e], faces[e1], faces[e2], faces[t2]];
    // The four sides keep their neighbours, which may be sides of the two faces themselves.
    const moved = (/** @type {number} */ edge) => (edge === e1 ? f + 2 : edge === e2 ? g + 1 : edge === t1 ? g + 2 : edge === t2 ? f + 1 : edge);
    const outside = [moved(twin[t2]), moved(twin[e1]), moved(twin[e2]), moved(twin[t1])];
    // New faces: (c, d, b) in place of f, and (d, c, a) in place of g.
    faces.set([c, d, b], f);
    faces.set([d, c, a], g);
    sides.set([length, ld, la], f);
    sides.set([length, lb, lc], g);
    twin[f] = g;
    twin[g] = f;
    [f + 1, f + 2, g + 1, g + 2].forEach((edge, k) => {
      twin[edge] = outside[k];
      if (outside[k] >= 0) twin[outside[k]] = edge;
      if (!waiting[edge]) {
        waiting[edge] = 1;
        queue.push(edge);
      }
    });
    flips++;
  }
  return flips;
}
