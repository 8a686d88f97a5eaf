// @ts-check
/**
 * Unfolds a field: the mesh of a level. Vertices on an edge of the base are made once, so that the mesh is closed where
 * the base is. The network runs on blocks of points.
 */
import { BLOCK, makeNetwork } from "./ndf-network.js";

/** @typedef {import("./ndf.js").NeuralField} NeuralField */
/**
 * A level: its vertices in world coordinates, and for each the three corners of the base and their weights.
 * @typedef {{ positions: Float32Array, indices: Uint32Array, corners: Uint32Array, weights: Float32Array }} Unfolded
 */

/** @type {WeakMap<NeuralField, ReturnType<typeof evaluator>>} */
const known = new WeakMap();

/** The mesh of a level: every edge of the base in 2^level pieces. @param {NeuralField} field @param {number} level @returns {Unfolded} */
export function unfold(field, level) {
  const { corners, weights, indices } = divide(field, 2 ** level);
  const evaluate = known.get(field) ?? evaluator(field);
  known.set(field, evaluate);
  return { positions: evaluate(corners, weights), indices, corners, weights };
}

/** Where the vertices of a level lie: three corners of the base (3V) and their weights (3V); and the faces. @param {NeuralField} field @param {number} pieces */
function divide({ faces, header }, pieces) {
  const count = faces.length / 3;
  const inner = pieces - 1;
  /** @type {Map<number, number>} The number of the first inner vertex of each edge of the base. */
  const edges = new Map();
  const first = new Uint32Array(3 * count); // the same for each side of a face
  let made = header.vertices;
  for (let i = 0; i < faces.length; i++) {
    const a = faces[i];
    const b = faces[i % 3 === 2 ? i - 2 : i + 1];
    const key = Math.min(a, b) * header.vertices + Math.max(a, b);
    const found = edges.get(key);
    first[i] = found ?? made;
    if (found !== undefined) continue;
    edges.set(key, made);
    made += inner;
  }
  const total = made + (count * inner * (pieces - 2)) / 2;
  const corners = new Uint32Array(3 * total);
  const weights = new Float32Array(3 * total);
  for (let v = 0; v < header.vertices; v++) {
    corners.fill(v, 3 * v, 3 * v + 3);
    weights[3 * v] = 1;
  }
  for (const [key, start] of edges) {
    const [a, b] = [Math.floor(key / header.vertices), key % header.vertices];
    for (let along = 1, at = 3 * start; along < pieces; along++, at += 3) {
      corners[at] = a;
      corners[at + 1] = corners[at + 2] = b;
      weights[at] = 1 - along / pieces;
      weights[at + 1] = along / pieces;
    }
  }
  const pattern = patternOf(pieces);
  const indices = new Uint32Array(3 * count * pieces * pieces);
  const row = pieces + 1;
  const table = new Uint32Array(row * row); // i steps from corner 0 to corner 1, and j to corner 2
  let next = made;
  for (let face = 0, out = 0; face < count; face++) {
    const [ab, bc, ca] = [3 * face, 3 * face + 1, 3 * face + 2];
    const [a, b, c] = [faces[ab], faces[bc], faces[ca]];
    table[0] = a;
    table[pieces * row] = b;
    table[pieces] = c;
    for (let s = 1; s < pieces; s++) {
      // Inner vertices of an edge are counted from the smaller of its ends.
      table[s * row] = first[ab] + (a < b ? s : pieces - s) - 1;
      table[(pieces - s) * row + s] = first[bc] + (b < c ? s : pieces - s) - 1;
      table[pieces - s] = first[ca] + (c < a ? s : pieces - s) - 1;
    }
    for (let i = 1; i < inner; i++) {
      for (let j = 1; j < pieces - i; j++) {
        const at = 3 * next;
        corners[at] = a;
        corners[at + 1] = b;
        corners[at + 2] = c;
        weights[at] = (pieces - i - j) / pieces;
        weights[at + 1] = i / pieces;
        weights[at + 2] = j / pieces;
        table[i * row + j] = next++;
      }
    }
    for (let k = 0; k < pattern.length; k++) indices[out++] = table[pattern[k]];
  }
  return { corners, weights, indices };
}

/** The triangles of one face, as cells of its table. @param {number} pieces */
function patternOf(pieces) {
  const row = pieces + 1;
  const found = [];
  for (let i = 0; i < pieces; i++) {
    for (let j = 0; j < pieces - i; j++) {
      const at = i * row + j;
      found.push(at, at + row, at + 1);
      if (i + j < pieces - 1) found.push(at + row, at + row + 1, at + 1);
    }
  }
  return Uint32Array.from(found);
}

/** A function from corners and weights to points (3V) of the surface, in the world. @param {NeuralField} field */
function evaluator({ header, verts, features, layers }) {
  const { features: d, octaves, widths, centre, scale } = header;
  const { values, run } = makeNetwork(widths, layers);
  const points = new Float64Array(3 * BLOCK);

  /** @param {Uint32Array} corners @param {Float32Array} weights */
  return (corners, weights) => {
    const out = new Float32Array(corners.length);
    for (let start = 0; start < corners.length; start += 3 * BLOCK) {
      const end = Math.min(BLOCK, (corners.length - start) / 3);
      for (let p = 0, at = start; p < end; p++, at += 3) {
        const [a, b, c] = [corners[at], corners[at + 1], corners[at + 2]];
        const [wa, wb, wc] = [weights[at], weights[at + 1], weights[at + 2]];
        for (let i = 0; i < d; i++) values[i * BLOCK + p] = wa * features[a * d + i] + wb * features[b * d + i] + wc * features[c * d + i];
        for (let axis = 0; axis < 3; axis++) {
          const point = wa * verts[3 * a + axis] + wb * verts[3 * b + axis] + wc * verts[3 * c + axis];
          points[3 * p + axis] = values[(d + axis) * BLOCK + p] = point;
          let [sine, cosine] = [Math.sin(Math.PI * point), Math.cos(Math.PI * point)];
          for (let k = 0, row = d + 3 + axis; k < octaves; k++, row += 6) {
            values[row * BLOCK + p] = sine;
            values[(row + 3) * BLOCK + p] = cosine;
            [sine, cosine] = [2 * sine * cosine, 1 - 2 * sine * sine]; // of twice the angle
          }
        }
      }
      const moved = run();
      for (let p = 0; p < end; p++)
        for (let axis = 0; axis < 3; axis++) out[start + 3 * p + axis] = centre[axis] + scale * (points[3 * p + axis] + values[moved + axis * BLOCK + p]);
    }
    return out;
  };
}
