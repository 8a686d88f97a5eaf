// @ts-check
/**
 * One layer of a small network for 128 points at once: WebAssembly with SIMD, assembled here, since it is one function
 * and the page has no build step. Where a browser has no SIMD, the same in JavaScript.
 *
 * Values lie by rows: the 128 values of input 0, of input 1, and so on. Weights lie in groups of four outputs: their four
 * biases, then for each input its four weights.
 */

/** Points of a block. */
export const BLOCK = 128;
const ROW = 4 * BLOCK; // bytes

/**
 * @callback Layer
 * @param {number} x Byte address of the inputs.
 * @param {number} w Of the weights.
 * @param {number} y Where to write the outputs.
 * @param {number} inputs
 * @param {number} quads Groups of four outputs.
 * @param {number} silu Whether x / (1 + exp(-x)) follows.
 * @returns {void}
 */

/** @param {number} bytes of memory that is needed @param {boolean} [simd] False: in JavaScript. @returns {{ memory: ArrayBuffer, layer: Layer }} */
export function makeKernel(bytes, simd = true) {
  const pages = Math.ceil(bytes / 65536);
  if (simd) {
    try {
      const { exports } = new WebAssembly.Instance(new WebAssembly.Module(assemble(pages)));
      return { memory: /** @type {WebAssembly.Memory} */ (exports.memory).buffer, layer: /** @type {Layer} */ (exports.layer) };
    } catch (error) {
      if (!(error instanceof WebAssembly.CompileError)) throw error;
    }
  }
  const memory = new ArrayBuffer(65536 * pages);
  return { memory, layer: plainLayer(new Float32Array(memory)) };
}

/** @param {Float32Array} values @returns {Layer} */
function plainLayer(values) {
  return (x, w, y, inputs, quads, silu) => {
    let at = w / 4;
    for (let quad = 0; quad < quads; quad++, at += 4 + 4 * inputs) {
      for (let p = 0; p < BLOCK; p++) {
        const sums = [values[at], values[at + 1], values[at + 2], values[at + 3]];
        for (let i = 0, from = x / 4 + p, k = at + 4; i < inputs; i++, from += BLOCK, k += 4)
          for (let row = 0; row < 4; row++) sums[row] += values[from] * values[k + row];
        for (let row = 0; row < 4; row++)
          values[y / 4 + (4 * quad + row) * BLOCK + p] = silu ? sums[row] / (1 + Math.exp(-sums[row])) : sums[row];
      }
    }
  };
}

/** @param {number} value @returns {number[]} LEB128; for constants below 2^31 the signed form has the same bits here */
function leb(value) {
  const out = [];
  for (; value > 63; value = Math.floor(value / 128)) out.push((value & 127) | 128);
  return [...out, value];
}

/** @param {number} pages @returns {Uint8Array<ArrayBuffer>} The module: `memory`, and `layer` with six numbers. */
function assemble(pages) {
  const get = (/** @type {number} */ name) => [0x20, name];
  const set = (/** @type {number} */ name) => [0x21, name];
  const number = (/** @type {number} */ value) => [0x41, ...leb(value)];
  const step = (/** @type {number} */ name, /** @type {number} */ by) => [...get(name), ...number(by), 0x6a, ...set(name)];
  const simd = (/** @type {number} */ op, /** @type {number[]} */ ...more) => [0xfd, ...(op > 127 ? [(op & 127) | 128, op >> 7] : [op]), ...more];
  const load = (/** @type {number} */ name, /** @type {number} */ offset) => [...get(name), ...simd(0, 2, ...leb(offset))];
  const spread = (/** @type {number} */ name, /** @type {number} */ offset) => [...get(name), ...simd(9, 2, ...leb(offset))];
  const constant = (/** @type {number} */ value) => {
    const bytes = new Uint8Array(new Float32Array(4).fill(value).buffer);
    return simd(12, ...bytes);
  };
  const [add, sub, mul, div, min, max, nearest] = [228, 229, 230, 231, 232, 233, 106].map((op) => simd(op));
  /** A loop that goes on while what its body leaves is not 0. @param {number[]} body */
  const loop = (...body) => [0x03, 0x40, ...body, 0x0d, 0, 0x0b];
  const [X, W, Y, INPUTS, QUADS, SILU, AT, LEFT, FROM, WITH, SUM, VALUE, POWER, REST] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 14, 15, 16];
  const rows = [0, 1, 2, 3];

  // exp(-x) = 2^n 2^f with n whole and f in [-1/2, 1/2], the second by its Taylor series.
  const series = [1, 2, 3, 4, 5, 6].map((k) => Math.LN2 ** k / [1, 1, 2, 6, 24, 120, 720][k]);
  const activate = (/** @type {number} */ sum) => [
    ...get(sum), ...constant(-Math.LOG2E), ...mul, ...constant(-126), ...max, ...constant(126), ...min, ...set(VALUE),
    ...get(VALUE), ...nearest, ...set(POWER),
    ...get(VALUE), ...get(POWER), ...sub, ...set(REST),
    ...constant(series[5]),
    ...[4, 3, 2, 1, 0].flatMap((k) => [...get(REST), ...mul, ...constant(series[k]), ...add]),
    ...get(REST), ...mul, ...constant(1), ...add,
    // 2^n is a float32 whose exponent is n + 127.
    ...get(POWER), ...constant(127), ...add, ...simd(248), ...number(23), ...simd(171), ...mul,
    ...constant(1), ...add, ...set(VALUE),
    ...get(sum), ...get(VALUE), ...div, ...set(sum),
  ];
  const body = loop(
    ...number(0), ...set(AT),
    ...loop(
      ...rows.flatMap((row) => [...spread(W, 4 * row), ...set(SUM + row)]),
      ...get(W), ...number(16), 0x6a, ...set(WITH),
      ...get(X), ...get(AT), 0x6a, ...set(FROM),
      ...get(INPUTS), ...set(LEFT),
      ...loop(
        ...load(FROM, 0), ...set(VALUE),
        ...rows.flatMap((row) => [...get(VALUE), ...spread(WITH, 4 * row), ...mul, ...get(SUM + row), ...add, ...set(SUM + row)]),
        ...step(FROM, ROW), ...step(WITH, 16),
        ...get(LEFT), ...number(1), 0x6b, 0x22, LEFT,
      ),
      ...get(SILU), 0x04, 0x40, ...rows.flatMap((row) => activate(SUM + row)), 0x0b,
      ...rows.flatMap((row) => [...get(Y), ...get(AT), 0x6a, ...get(SUM + row), ...simd(11, 2, ...leb(ROW * row))]),
      ...step(AT, 16),
      ...get(AT), ...number(ROW), 0x49,
    ),
    ...step(Y, 4 * ROW),
    ...get(WITH), ...set(W),
    ...get(QUADS), ...number(1), 0x6b, 0x22, QUADS,
  );
  const code = [2, 4, 0x7f, 7, 0x7b, ...body, 0x0b]; // four i32 and seven v128 besides the parameters
  const section = (/** @type {number} */ id, /** @type {number[]} */ content) => [id, ...size(content.length), ...content];
  const name = (/** @type {string} */ text) => [text.length, ...new TextEncoder().encode(text)];
  return new Uint8Array([
    0, 0x61, 0x73, 0x6d, 1, 0, 0, 0,
    ...section(1, [1, 0x60, 6, 0x7f, 0x7f, 0x7f, 0x7f, 0x7f, 0x7f, 0]),
    ...section(3, [1, 0]),
    ...section(5, [1, 0, ...size(pages)]),
    ...section(7, [2, ...name("memory"), 2, 0, ...name("layer"), 0, 0]),
    ...section(10, [1, ...size(code.length), ...code]),
  ]);
}

/** @param {number} value @returns {number[]} unsigned LEB128 */
function size(value) {
  const out = [];
  for (; value > 127; value >>>= 7) out.push((value & 127) | 128);
  return [...out, value];
}
