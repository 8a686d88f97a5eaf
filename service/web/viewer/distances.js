// @ts-check
/**
 * Distances along a surface from one of its vertices. A front goes over the triangles: a corner's distance comes straight across
 * its triangle, from where a point at the distances of the other two would lie in its plane, or along an edge.
 *
 * Source: Kimmel and Sethian 1998, Computing Geodesic Paths on Manifolds; the update by unfolded sources is that of Novotni and Klein 2002.
 */

const GAIN = 1e-6; // of a distance: what gets shorter by less is as good as settled

/** @param {Float32Array} positions (3V) @param {Uint32Array} indices (3F) @param {number} source @returns {Float64Array} (V) infinite on parts without the source */
export function distancesFrom(positions, indices, source) {
  const count = positions.length / 3;
  const { starts, around } = facesAround(indices, count);
  const distances = new Float64Array(count).fill(Infinity);
  const waiting = new Uint8Array(count);
  distances[source] = 0;
  let front = [source];
  while (front.length) {
    /** @type {number[]} */
    const next = [];
    const reach = (/** @type {number} */ vertex, /** @type {number} */ distance) => {
      if (!(distance < distances[vertex] * (1 - GAIN))) return;
      distances[vertex] = distance;
      if (!waiting[vertex]) next.push(vertex);
      waiting[vertex] = 1;
    };
    // Those that are near go first: what is behind them is then reached once.
    front.sort((a, b) => distances[a] - distances[b]);
    for (const vertex of front) {
      waiting[vertex] = 0;
      for (let i = starts[vertex]; i < starts[vertex + 1]; i++) {
        const f = around[i] - (around[i] % 3);
        const [a, b] = [indices[f + ((around[i] + 1) % 3)], indices[f + ((around[i] + 2) % 3)]];
        reach(a, across(positions, distances, vertex, b, a));
        reach(b, across(positions, distances, vertex, a, b));
      }
    }
    front = next;
  }
  return distances;
}

/** The corners at each vertex, one list after the other. @param {Uint32Array} indices @param {number} count */
export function facesAround(indices, count) {
  const starts = new Uint32Array(count + 1);
  for (const vertex of indices) starts[vertex + 1]++;
  for (let v = 0; v < count; v++) starts[v + 1] += starts[v];
  const around = new Uint32Array(indices.length);
  const next = starts.slice();
  indices.forEach((vertex, corner) => (around[next[vertex]++] = corner));
  return { starts, around };
}

/** How far c is, by its triangle with a and b. @param {Float32Array} positions @param {Float64Array} distances @param {number} a @param {number} b @param {number} c */
function across(positions, distances, a, b, c) {
  const [ab, ac, bc] = [apart(positions, a, b), apart(positions, a, c), apart(positions, b, c)];
  const along = Math.min(distances[a] + ac, distances[b] + bc);
  if (!(distances[b] < Infinity) || !(ab > 0)) return along;
  // In the plane a lies at (0, 0), b at (ab, 0), c above them and the source below.
  const x = (ab * ab + ac * ac - bc * bc) / (2 * ab);
  const y = Math.sqrt(Math.max(ac * ac - x * x, 0));
  const from = (ab * ab + distances[a] ** 2 - distances[b] ** 2) / (2 * ab);
  const below = Math.sqrt(Math.max(distances[a] ** 2 - from * from, 0));
  const crossing = from + ((x - from) * below) / (below + y || 1);
  return crossing > 0 && crossing < ab ? Math.min(along, Math.hypot(x - from, y + below)) : along;
}

/** @param {Float32Array} positions @param {number} a @param {number} b */
function apart(positions, a, b) {
  return Math.hypot(positions[3 * a] - positions[3 * b], positions[3 * a + 1] - positions[3 * b + 1], positions[3 * a + 2] - positions[3 * b + 2]);
}
