// @ts-check
/**
 * Places on a surface: white noise, evenly likely everywhere, and blue noise, which also keeps its distance.
 *
 * A field maps equal parts of a base triangle to triangles of other areas; their ratio is det J of the map. Triangles of
 * a level that are drawn by their area are therefore places of the base drawn by det J.
 *
 * Source: Yuksel 2015, Sample Elimination for Generating Poisson Disk Sample Sets.
 */

const CANDIDATES = 5; // for each sample of blue noise
const POWER = 8;

/**
 * @param {Float32Array} positions (3V)
 * @param {Uint32Array} indices (3F)
 * @param {number} count
 * @param {number} [seed]
 * @returns {{ points: Float32Array, normals: Float32Array, area: number }} points (3 count) and unit normals there
 */
export function whiteNoise(positions, indices, count, seed = 1) {
  const faces = indices.length / 3;
  const until = new Float64Array(faces); // area of all faces up to this one
  const facing = new Float32Array(3 * faces);
  let area = 0;
  for (let f = 0; f < faces; f++) {
    const [a, b, c] = [3 * indices[3 * f], 3 * indices[3 * f + 1], 3 * indices[3 * f + 2]];
    const [ux, uy, uz] = [0, 1, 2].map((k) => positions[b + k] - positions[a + k]);
    const [vx, vy, vz] = [0, 1, 2].map((k) => positions[c + k] - positions[a + k]);
    const cross = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    const size = Math.hypot(...cross);
    until[f] = area += size / 2;
    for (let k = 0; k < 3; k++) facing[3 * f + k] = size > 0 ? cross[k] / size : 0;
  }
  const random = generator(seed);
  const [points, normals] = [new Float32Array(3 * count), new Float32Array(3 * count)];
  for (let i = 0; i < count; i++) {
    const wanted = random() * area;
    let [low, high] = [0, faces - 1];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (until[middle] > wanted) high = middle;
      else low = middle + 1;
    }
    const root = Math.sqrt(random());
    const weights = [1 - root, root * random(), 0];
    weights[2] = 1 - weights[0] - weights[1];
    for (let k = 0; k < 3; k++) {
      for (let corner = 0; corner < 3; corner++) points[3 * i + k] += weights[corner] * positions[3 * indices[3 * low + corner] + k];
      normals[3 * i + k] = facing[3 * low + k];
    }
  }
  return { points, normals, area };
}

/**
 * White noise of five times as many places, of which the most crowded one goes, again and again.
 * @param {Float32Array} positions (3V)
 * @param {Uint32Array} indices (3F)
 * @param {number} count
 * @param {number} [seed]
 * @returns {Float32Array} (3 count)
 */
export function blueNoise(positions, indices, count, seed = 1) {
  const { points, normals, area } = whiteNoise(positions, indices, CANDIDATES * count, seed);
  const reach = 2 * Math.sqrt(area / (2 * Math.sqrt(3) * count)); // of two samples in the densest packing
  const near = neighbours(points, normals, reach);
  const all = points.length / 3;
  const crowd = new Float64Array(all);
  for (let i = 0; i < all; i++) for (const { weight } of near[i]) crowd[i] += weight;
  // A heap of those that are left, the most crowded one on top.
  const heap = Uint32Array.from({ length: all }, (_, i) => i);
  const place = heap.slice();
  let size = all;
  const swap = (/** @type {number} */ a, /** @type {number} */ b) => {
    [heap[a], heap[b]] = [heap[b], heap[a]];
    place[heap[a]] = a;
    place[heap[b]] = b;
  };
  const sink = (/** @type {number} */ at) => {
    for (;;) {
      let most = at;
      for (const child of [2 * at + 1, 2 * at + 2]) if (child < size && crowd[heap[child]] > crowd[heap[most]]) most = child;
      if (most === at) return;
      swap(at, most);
      at = most;
    }
  };
  for (let at = all >> 1; at >= 0; at--) sink(at);
  while (size > count) {
    const gone = heap[0];
    swap(0, --size);
    sink(0);
    for (const { other, weight } of near[gone]) {
      if (place[other] >= size) continue;
      crowd[other] -= weight;
      sink(place[other]); // less crowded than before: further down
    }
  }
  const out = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) out.set(points.subarray(3 * heap[i], 3 * heap[i] + 3), 3 * i);
  return out;
}

/**
 * Pairs that are nearer than `reach` and face the same way: the two sides of a thin wall do not crowd each other.
 * @param {Float32Array} points @param {Float32Array} normals @param {number} reach
 */
function neighbours(points, normals, reach) {
  /** @type {Map<string, number[]>} */
  const cells = new Map();
  const cell = (/** @type {number} */ i) => [0, 1, 2].map((k) => Math.floor(points[3 * i + k] / reach));
  /** @type {{ other: number, weight: number }[][]} */
  const near = Array.from({ length: points.length / 3 }, () => []);
  for (let i = 0; i < near.length; i++) {
    const [x, y, z] = cell(i);
    for (let dx = -1; dx <= 1; dx++) {
      for (let dy = -1; dy <= 1; dy++) {
        for (let dz = -1; dz <= 1; dz++) {
          for (const other of cells.get(`${x + dx} ${y + dy} ${z + dz}`) ?? []) {
            const apart = Math.hypot(points[3 * i] - points[3 * other], points[3 * i + 1] - points[3 * other + 1], points[3 * i + 2] - points[3 * other + 2]);
            const facing = normals[3 * i] * normals[3 * other] + normals[3 * i + 1] * normals[3 * other + 1] + normals[3 * i + 2] * normals[3 * other + 2];
            if (apart >= reach || facing < 0) continue;
            const weight = (1 - apart / reach) ** POWER;
            near[i].push({ other, weight });
            near[other].push({ other: i, weight });
          }
        }
      }
    }
    const key = `${x} ${y} ${z}`;
    const here = cells.get(key);
    if (here) here.push(i);
    else cells.set(key, [i]);
  }
  return near;
}

/** Numbers in [0, 1), the same for the same seed (mulberry32). @param {number} seed */
export function generator(seed) {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let mixed = Math.imul(state ^ (state >>> 15), 1 | state);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 4294967296;
  };
}
