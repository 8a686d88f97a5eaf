// @ts-check
/** A small network on blocks of points (ndf-kernel.js): SiLU follows every layer but the last. */
import { BLOCK, makeKernel } from "./ndf-kernel.js";

/** @typedef {{ weight: Float32Array, bias: Float32Array }} Layer */

export { BLOCK };

/**
 * @param {number[]} widths Of the inputs, then of all layers.
 * @param {Layer[]} layers
 * @param {boolean} simd
 * @returns {{ values: Float32Array, run: () => number }} Input i of point p belongs at i BLOCK + p of the values; `run` returns where the
 *     outputs begin, in the same order.
 */
export function makeNetwork(widths, layers, simd) {
  const quads = widths.slice(1).map((width) => Math.ceil(width / 4));
  // Memory: two buffers that the layers use by turns, then their weights.
  const widest = Math.max(widths[0], ...quads.map((count) => 4 * count));
  const buffer = 4 * BLOCK * widest;
  const sizes = quads.map((count, i) => 16 * count * (1 + widths[i]));
  const { memory, layer } = makeKernel(sizes.reduce((sum, size) => sum + size, 2 * buffer), simd);
  const values = new Float32Array(memory);
  /** @type {number[]} */
  const starts = [];
  for (let i = 0, at = 2 * buffer; i < layers.length; at += sizes[i++]) {
    starts.push(at);
    const { weight, bias } = layers[i];
    const from = widths[i];
    for (let output = 0; output < widths[i + 1]; output++) {
      const group = at / 4 + (output >> 2) * 4 * (1 + from) + (output & 3);
      values[group] = bias[output];
      for (let k = 0; k < from; k++) values[group + 4 * (k + 1)] = weight[output * from + k];
    }
  }
  const run = () => {
    let [from, to] = [0, buffer];
    for (let i = 0; i < layers.length; i++) {
      layer(from, starts[i], to, widths[i], quads[i], i + 1 < layers.length ? 1 : 0);
      [from, to] = [to, from];
    }
    return from / 4;
  };
  return { values, run };
}
