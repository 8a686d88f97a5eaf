// @ts-check
/**
 * The scalars that a `.ndf` holds beside its surface: offset + scale MLP(features), the features interpolated along the base. The counterpart
 * in Python is `meshdeform/kinds/surface_fit/scalar_sections.py`; a test compares the two.
 *
 * @typedef {object} Scalars
 * @property {string} name
 * @property {number[]} widths Of the features, then of all layers.
 * @property {number[]} offset
 * @property {number[]} scale
 * @property {number[]} labels The number of the piece that each output stands for; empty for scalars.
 * @property {Float32Array} features (V, d).
 * @property {import("./ndf-network.js").Layer[]} layers
 */
import { BLOCK, makeNetwork } from "./ndf-network.js";

/** @type {WeakMap<Scalars, ReturnType<typeof makeNetwork>>} */
const known = new WeakMap();

/**
 * One output, or the piece, at points of the base.
 * @param {Scalars} scalars
 * @param {Uint32Array} corners Of the base, three for each point.
 * @param {Float32Array} weights
 * @param {number} output Of scalars; pieces have one answer: the index of the greatest output in `labels`.
 * @returns {Float32Array}
 */
export function scalarsAt(scalars, corners, weights, output) {
  const { widths, offset, scale, labels, features } = scalars;
  const network = known.get(scalars) ?? makeNetwork(widths, scalars.layers);
  known.set(scalars, network);
  const { values, run } = network;
  const [d, outputs] = [widths[0], widths[widths.length - 1]];
  const found = new Float32Array(corners.length / 3);
  for (let start = 0; start < found.length; start += BLOCK) {
    const end = Math.min(BLOCK, found.length - start);
    for (let p = 0, at = 3 * start; p < end; p++, at += 3) {
      const [a, b, c] = [d * corners[at], d * corners[at + 1], d * corners[at + 2]];
      const [wa, wb, wc] = [weights[at], weights[at + 1], weights[at + 2]];
      for (let i = 0; i < d; i++) values[i * BLOCK + p] = wa * features[a + i] + wb * features[b + i] + wc * features[c + i];
    }
    const out = run();
    for (let p = 0; p < end; p++) {
      if (labels.length) {
        let best = 0;
        for (let k = 1; k < outputs; k++) if (values[out + k * BLOCK + p] > values[out + best * BLOCK + p]) best = k;
        found[start + p] = best;
      } else found[start + p] = offset[output] + scale[output] * values[out + output * BLOCK + p];
    }
  }
  return found;
}
