// @ts-check
/**
 * Reads `.ndf` files (docs/surface_fit.md); ndf-unfold.js makes meshes of them. The counterpart in Python is `meshdeform/kinds/surface_fit/reader.py`;
 * a test compares the two. Needs no page: it also runs in a worker and in Node.js.
 *
 * @typedef {object} NeuralField
 * @property {any} header
 * @property {Float64Array} verts The base (V, 3) in the frame.
 * @property {Uint32Array} faces (F, 3).
 * @property {Float32Array} features (V, d).
 * @property {import("./ndf-network.js").Layer[]} layers
 * @property {import("./ndf-scalars.js").Scalars[]} scalars
 */

import { checkHeader, TORN } from "./ndf-header.js";

export { scalarsAt } from "./ndf-scalars.js";
export { unfold } from "./ndf-unfold.js";

/** @param {Uint8Array} data @returns {Promise<NeuralField>} @throws {Error} The file is damaged, incomplete, or of another version. */
export async function readField(data) {
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  if (data.length < 12 || data[0] !== 78 || data[1] !== 68 || data[2] !== 70) throw new Error("The file is not a .ndf.");
  if (data[3] !== 2) throw new Error(`The .ndf has version ${data[3]}; this reader knows version 2.`);
  if (crc32(data.subarray(0, -4)) !== view.getUint32(data.length - 4, true))
    throw new Error("The .ndf is damaged or incomplete: its checksum is wrong.");
  let at = 8 + view.getUint32(4, true);
  const header = parsed(data.subarray(8, at));
  checkHeader(header, data.length - 4 - at);
  const { vertices, faces: count } = header;
  /** @type {Uint16Array[]} */
  const sections = [];
  for (const [size, expected] of header.sections) {
    sections.push(await numbers(data.subarray(at, at + size), expected));
    at += size;
  }
  const base = decodeBase(sections[0], sections[1], vertices, count, header.bits);
  const { features, layers } = networkOf(sections[2], vertices, [header.features, ...header.widths], header.steps);
  const scalars = (header.scalars ?? []).map((/** @type {any} */ given, /** @type {number} */ i) => {
    const { name, widths, offset, scale, labels = [], steps } = given;
    return { name: String(name), widths, offset, scale, labels, ...networkOf(sections[3 + i], vertices, [widths[0], ...widths], steps) };
  });
  return { header, ...base, features, layers, scalars };
}

/** @param {Uint8Array} bytes @returns {any} */
function parsed(bytes) {
  try {
    return JSON.parse(new TextDecoder().decode(bytes));
  } catch {
    throw new Error(TORN);
  }
}

/**
 * @param {Uint16Array} numbers @param {number} vertices
 * @param {number[]} widths Features of each vertex, then the inputs and the outputs of all layers.
 * @param {number[]} steps Exponents n of the steps 2^(n / 4): of each channel of the features, then of each weight and bias.
 */
function networkOf(numbers, vertices, [each, ...widths], steps) {
  const weights = Float32Array.from(numbers, signed);
  const sizes = steps.map((step) => 2 ** (step / 4));
  let from = vertices * each;
  const features = weights.subarray(0, from);
  for (let i = 0; i < from; i++) features[i] *= sizes[i % each];
  let tensor = each;
  /** @param {number} size */
  const take = (size) => {
    const tensorValues = weights.subarray(from, from + size);
    for (let i = 0; i < tensorValues.length; i++) tensorValues[i] *= sizes[tensor];
    from += size;
    tensor++;
    return tensorValues;
  };
  const layers = [];
  for (let i = 1; i < widths.length; i++) layers.push({ weight: take(widths[i - 1] * widths[i]), bias: take(widths[i]) });
  return { features, layers };
}

/**
 * @param {Uint16Array} symbols @param {Uint16Array} steps @param {number} vertices @param {number} count @param {number} bits
 * @returns {{ verts: Float64Array, faces: Uint32Array }}
 */
function decodeBase(symbols, steps, vertices, count, bits) {
  const positions = new Int32Array(3 * vertices);
  const faces = new Uint32Array(3 * count);
  /** @type {Map<number, [number, number, number]>} Open edges, oldest first, with the third corner of their face. */
  const open = new Map();
  let [made, done, at] = [0, 0, 0];
  const take = () => {
    if (at >= symbols.length) throw new Error(TORN);
    return symbols[at++];
  };
  /** @param {number} symbol @param {(axis: number) => number} guess */
  const corner = (symbol, guess) => {
    if (symbol > made || (symbol === 0 && made >= vertices)) throw new Error(TORN);
    if (symbol) return made - symbol;
    for (let axis = 0; axis < 3; axis++) {
      positions[3 * made + axis] = guess(axis) + signed(steps[3 * made + axis]);
    }
    return made++;
  };
  /** @param {number} a @param {number} b @param {number} c */
  const add = (a, b, c) => {
    if (a === b || b === c || c === a) throw new Error(TORN);
    faces.set([a, b, c], 3 * done++);
    for (const [one, other, rest] of [[a, b, c], [b, c, a], [c, a, b]])
      if (!open.delete(other * vertices + one)) open.set(one * vertices + other, [one, other, rest]);
  };
  while (done < count) {
    const first = open.values().next();
    if (first.done) {
      const last = made - 1;
      const a = corner(take(), (axis) => (last < 0 ? 0 : positions[3 * last + axis]));
      const b = corner(take(), (axis) => positions[3 * a + axis]);
      add(a, b, corner(take(), (axis) => positions[3 * b + axis]));
      continue;
    }
    const [a, b, rest] = first.value;
    const symbol = take();
    if (symbol) add(b, a, corner(symbol - 1, (axis) => positions[3 * a + axis] + positions[3 * b + axis] - positions[3 * rest + axis]));
    else open.delete(a * vertices + b); // a border
  }
  if (made < vertices) throw new Error(TORN);
  const most = 2 ** (bits - 1) - 1;
  return { verts: Float64Array.from(positions, (position) => position / most - 1), faces };
}

/** Unpacks a section of 16-bit numbers, whose low bytes come first, then the high ones. @param {Uint8Array} data @param {number} size */
async function numbers(data, size) {
  const unpacker = new DecompressionStream("deflate-raw");
  const reader = new Blob([/** @type {BlobPart} */ (data)]).stream().pipeThrough(unpacker).getReader();
  const bytes = new Uint8Array(size);
  let at = 0;
  for (let chunk = await reader.read(); !chunk.done; chunk = await reader.read()) {
    if (at + chunk.value.length > size) {
      await reader.cancel();
      throw new Error("A section of the .ndf has another size than stated.");
    }
    bytes.set(chunk.value, at);
    at += chunk.value.length;
  }
  if (at !== size) throw new Error("A section of the .ndf has another size than stated.");
  return Uint16Array.from({ length: size / 2 }, (_, i) => bytes[i] | (bytes[size / 2 + i] << 8));
}

/** The whole number of 0, -1, 1, -2, 2, ... @param {number} number */
function signed(number) {
  return (number >> 1) ^ -(number & 1);
}

/** @param {Uint8Array} data */
function crc32(data) {
  let crc = -1;
  for (const byte of data) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = (crc >>> 1) ^ (0xedb88320 & -(crc & 1));
  }
  return ~crc >>> 0;
}
