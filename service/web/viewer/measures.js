// @ts-check
/**
 * What a deformation does to a surface, as numbers: how far each vertex went, and how much each face was stretched.
 * No WebGL and no three.js here, so that node can test it.
 */

/**
 * How far each vertex moved.
 * @param {ArrayLike<number>} before (3V) positions in world units
 * @param {ArrayLike<number>} after (3V) the same vertices, deformed
 * @returns {Float64Array} (V) distances in world units
 */
export function displacement(before, after) {
  const distances = new Float64Array(before.length / 3);
  for (let v = 0; v < distances.length; v++) {
    const i = 3 * v;
    distances[v] = Math.hypot(after[i] - before[i], after[i + 1] - before[i + 1], after[i + 2] - before[i + 2]);
  }
  return distances;
}

/**
 * How much each triangle was stretched or squeezed: max(σ1, 1/σ2) of the linear map that takes it to its new shape.
 *
 * 1 is a rigid motion, 2 means that some direction became twice as long or half as long. The singular values come from
 * the metrics: σ² are the eigenvalues of G⁻¹H, where G and H are the Gram matrices of two edges before and after.
 * @param {ArrayLike<number>} before (3V) positions
 * @param {ArrayLike<number>} after (3V) positions
 * @param {ArrayLike<number>} corners (3F) vertex of each corner
 * @returns {Float64Array} (F) stretch, at least 1; Infinity where the face collapsed, NaN where it had no area before
 */
export function stretch(before, after, corners) {
  const values = new Float64Array(corners.length / 3);
  const rest = new Float64Array(3);
  const now = new Float64Array(3);
  for (let f = 0; f < values.length; f++) {
    gram(before, corners, f, rest);
    gram(after, corners, f, now);
    const restArea = rest[0] * rest[2] - rest[1] * rest[1];
    if (!(restArea > 1e-12 * rest[0] * rest[2]) || restArea <= 0) {
      values[f] = NaN;
      continue;
    }
    const area = Math.max(0, now[0] * now[2] - now[1] * now[1]) / restArea;
    const trace = (rest[2] * now[0] - 2 * rest[1] * now[1] + rest[0] * now[2]) / restArea;
    const larger = (trace + Math.sqrt(Math.max(0, trace * trace - 4 * area))) / 2;
    values[f] = Math.max(1, Math.sqrt(larger), Math.sqrt(larger / area));
  }
  return values;
}

/**
 * How much further the texture of each triangle is drawn out in its worst direction: the ratio of the larger singular
 * values of the maps from the texture to the triangle, after and before (Sander et al. 2001). Not free of scale yet.
 * @param {ArrayLike<number>} before (3V) positions
 * @param {ArrayLike<number>} after (3V) positions
 * @param {ArrayLike<number>} corners (3F) vertex of each corner
 * @param {ArrayLike<number>} texels (2V) coordinates in the texture
 * @returns {Float64Array} (F); NaN where the triangle had no area, in the texture or before
 */
export function textureStretch(before, after, corners, texels) {
  const values = new Float64Array(corners.length / 3);
  const metric = new Float64Array(3);
  for (let f = 0; f < values.length; f++) {
    const [i, j, k] = [2 * corners[3 * f], 2 * corners[3 * f + 1], 2 * corners[3 * f + 2]];
    const [u1, v1] = [texels[j] - texels[i], texels[j + 1] - texels[i + 1]];
    const [u2, v2] = [texels[k] - texels[i], texels[k + 1] - texels[i + 1]];
    const area = u1 * v2 - u2 * v1;
    const largest = (/** @type {ArrayLike<number>} */ positions) => {
      gram(positions, corners, f, metric);
      const [aa, ab, bb] = metric;
      const a = (aa * v2 * v2 - 2 * ab * v1 * v2 + bb * v1 * v1) / (area * area);
      const b = (ab * (u1 * v2 + u2 * v1) - aa * u2 * v2 - bb * u1 * v1) / (area * area);
      const c = (bb * u1 * u1 - 2 * ab * u1 * u2 + aa * u2 * u2) / (area * area);
      return Math.sqrt((a + c + Math.hypot(a - c, 2 * b)) / 2);
    };
    const old = Math.abs(area) > 2e-9 ? largest(before) : 0;
    values[f] = old > 0 ? largest(after) / old : NaN;
  }
  return values;
}

/**
 * Gram matrix of a face's two edges from its first corner: (|a|², a·b, |b|²).
 * @param {ArrayLike<number>} positions
 * @param {ArrayLike<number>} corners
 * @param {number} face
 * @param {Float64Array} out
 */
function gram(positions, corners, face, out) {
  const [i, j, k] = [3 * corners[3 * face], 3 * corners[3 * face + 1], 3 * corners[3 * face + 2]];
  out.fill(0);
  for (let axis = 0; axis < 3; axis++) {
    const a = positions[j + axis] - positions[i + axis];
    const b = positions[k + axis] - positions[i + axis];
    out[0] += a * a;
    out[1] += a * b;
    out[2] += b * b;
  }
}

/** Twice the area of each triangle. @param {ArrayLike<number>} positions (3V) @param {ArrayLike<number>} corners (3F) @returns {Float64Array} (F) */
export function doubleAreas(positions, corners) {
  const areas = new Float64Array(corners.length / 3);
  const metric = new Float64Array(3);
  for (let f = 0; f < areas.length; f++) {
    gram(positions, corners, f, metric);
    areas[f] = Math.sqrt(Math.max(0, metric[0] * metric[2] - metric[1] * metric[1]));
  }
  return areas;
}

/**
 * Carry a value per face to the vertices: the mean over the faces around, weighted by their area before.
 * Vertices at one place (split at a seam) get one value, so that no seam shows.
 * @param {ArrayLike<number>} values (F); those that are not finite do not count
 * @param {ArrayLike<number>} weights (F)
 * @param {ArrayLike<number>} corners (3F)
 * @param {ArrayLike<number>} groups (V) number of the place of each vertex, as `weld` gives it
 * @returns {Float64Array} (V); NaN at vertices of no face
 */
export function averageToVertices(values, weights, corners, groups) {
  const sums = new Float64Array(groups.length);
  const totals = new Float64Array(groups.length);
  for (let f = 0; f < values.length; f++) {
    if (!Number.isFinite(values[f])) continue;
    for (let c = 3 * f; c < 3 * f + 3; c++) {
      const place = groups[corners[c]];
      sums[place] += values[f] * weights[f];
      totals[place] += weights[f];
    }
  }
  return Float64Array.from(groups, (place) => sums[place] / totals[place]);
}

/**
 * Smallest, largest and 99th percentile of the finite values.
 * @param {Float64Array[]} parts
 * @returns {{ min: number, max: number, p99: number, count: number }} zeros where nothing is finite
 */
export function summarize(parts) {
  const all = new Float64Array(parts.reduce((sum, part) => sum + part.length, 0));
  let count = 0;
  for (const part of parts) for (const value of part) if (Number.isFinite(value)) all[count++] = value;
  const sorted = all.subarray(0, count).sort();
  if (count === 0) return { min: 0, max: 0, p99: 0, count: 0 };
  const position = 0.99 * (count - 1);
  const low = Math.floor(position);
  const high = Math.min(low + 1, count - 1);
  const p99 = sorted[low] + (position - low) * (sorted[high] - sorted[low]);
  return { min: sorted[0], max: sorted[count - 1], p99, count };
}
