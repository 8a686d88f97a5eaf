// @ts-check
/** A small network on blocks of points: SiLU follows every layer but the last. */

/** @typedef {{ weight: Float32Array, bias: Float32Array }} Layer */

/** Points of a block. */
export const BLOCK = 128;

/**
 * @param {number[]} widths Of the inputs, then of all layers.
 * @param {Layer[]} layers
 * @returns {{ values: Float32Array, run: () => number }} Input i of point p belongs at i BLOCK + p of the values; `run` returns where the
 *     outputs begin, in the same order.
 */
export function makeNetwork(widths, layers) {
  const quads = widths.slice(1).map((width) => Math.ceil(width / 4));
  // Two buffers that the layers use by turns, then their weights in groups of four outputs: four biases, then for each input four weights.
  const buffer = BLOCK * Math.max(widths[0], ...quads.map((count) => 4 * count));
  const sizes = quads.map((count, i) => 4 * count * (1 + widths[i]));
  const values = new Float32Array(sizes.reduce((sum, size) => sum + size, 2 * buffer));
  /** @type {number[]} */
  const starts = [];
  for (let i = 0, at = 2 * buffer; i < layers.length; at += sizes[i++]) {
    starts.push(at);
    const { weight, bias } = layers[i];
    const from = widths[i];
    for (let output = 0; output < widths[i + 1]; output++) {
      const group = at + (output >> 2) * 4 * (1 + from) + (output & 3);
      values[group] = bias[output];
      for (let k = 0; k < from; k++) values[group + 4 * (k + 1)] = weight[output * from + k];
    }
  }
  const run = () => {
    let [from, to] = [0, buffer];
    for (let i = 0; i < layers.length; i++) {
      apply(values, from, starts[i], to, widths[i], quads[i], i + 1 < layers.length);
      [from, to] = [to, from];
    }
    return from;
  };
  return { values, run };
}

/**
 * One layer on a block, four outputs at once: their sums stay in registers.
 * @param {Float32Array} values @param {number} x where the inputs begin @param {number} w the weights @param {number} y the outputs
 * @param {number} inputs @param {number} quads groups of four outputs @param {boolean} silu whether x / (1 + exp(-x)) follows
 */
function apply(values, x, w, y, inputs, quads, silu) {
  for (let quad = 0, first = w, out = y; quad < quads; quad++, first += 4 + 4 * inputs, out += 4 * BLOCK) {
    const end = first + 4 + 4 * inputs;
    for (let p = 0; p < BLOCK; p++) {
      let [a, b, c, d] = [values[first], values[first + 1], values[first + 2], values[first + 3]];
      for (let from = x + p, k = first + 4; k < end; from += BLOCK, k += 4) {
        const value = values[from];
        a += value * values[k];
        b += value * values[k + 1];
        c += value * values[k + 2];
        d += value * values[k + 3];
      }
      values[out + p] = silu ? a / (1 + Math.exp(-a)) : a;
      values[out + BLOCK + p] = silu ? b / (1 + Math.exp(-b)) : b;
      values[out + 2 * BLOCK + p] = silu ? c / (1 + Math.exp(-c)) : c;
      values[out + 3 * BLOCK + p] = silu ? d / (1 + Math.exp(-d)) : d;
    }
  }
}
