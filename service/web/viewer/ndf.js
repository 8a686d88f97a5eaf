// @ts-check
/**
 * Reads `.ndf` files and unfolds them (docs/surface_fit.md). The counterpart in Python is `meshdeform/fields/reader.py`;
 * a test compares the two. Needs no page: it also runs in a worker and in Node.js.
 *
 * @typedef {object} NeuralField
 * @property {any} header
 * @property {Float64Array} verts The base (V, 3) in the frame.
 * @property {Uint32Array} faces (F, 3).
 * @property {Float32Array} features (V, d).
 * @property {{ weight: Float32Array, bias: Float32Array }[]} layers
 */

const MAX_FACES = 100_000;

/**
 * @param {Uint8Array} data
 * @returns {Promise<NeuralField>}
 * @throws {Error} The file is damaged, incomplete, or of another version.
 */
export async function readField(data) {
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  if (data.length < 12 || data[0] !== 78 || data[1] !== 68 || data[2] !== 70) throw new Error("The file is not a .ndf.");
  if (data[3] !== 1) throw new Error(`The .ndf has version ${data[3]}; this reader knows version 1.`);
  if (crc32(data.subarray(0, -4)) !== view.getUint32(data.length - 4, true))
    throw new Error("The .ndf is damaged or incomplete: its checksum is wrong.");
  let at = 8 + view.getUint32(4, true);
  const header = JSON.parse(new TextDecoder().decode(data.subarray(8, at)));
  const { vertices, faces: count } = header;
  if (!(count > 0 && count <= MAX_FACES && vertices > 0 && vertices <= 3 * count)) throw new Error("The .ndf states impossible counts.");
  const sections = [];
  for (const [size, expected] of header.sections) {
    sections.push(await numbers(data.subarray(at, at + size), expected));
    at += size;
  }
  const base = decodeBase(sections[0], sections[1], vertices, count, header.bits);
  const weights = Float32Array.from(sections[2], half);
  let from = vertices * header.features;
  const features = weights.subarray(0, from);
  const layers = [];
  for (let i = 1; i < header.widths.length; i++) {
    const size = header.widths[i - 1] * header.widths[i];
    layers.push({ weight: weights.subarray(from, from + size), bias: weights.subarray(from + size, from + size + header.widths[i]) });
    from += size + header.widths[i];
  }
  return { header, ...base, features, layers };
}

/**
 * The mesh of a level: every edge of the base in 2^level parts.
 *
 * @param {NeuralField} field
 * @param {number} level
 * @returns {{ positions: Float32Array, indices: Uint32Array }} In world coordinates.
 */
export function unfold(field, level) {
  const parts = 2 ** level;
  const { faces, header } = field;
  const count = faces.length / 3;
  /** @type {Map<number, number>} The number of the first inner vertex of each edge of the base. */
  const edges = new Map();
  let made = header.vertices;
  const inner = parts - 1;
  for (let i = 0; i < faces.length; i++) {
    const [a, b] = [faces[i], faces[i - (i % 3) + ((i + 1) % 3)]];
    const key = Math.min(a, b) * header.vertices + Math.max(a, b);
    if (!edges.has(key)) {
      edges.set(key, made);
      made += inner;
    }
  }
  const interior = made;
  const perFace = ((parts - 1) * (parts - 2)) / 2;
  const total = interior + count * perFace;
  const positions = new Float32Array(3 * total);
  const done = new Uint8Array(total);
  const indices = new Uint32Array(3 * count * parts * parts);
  const evaluate = evaluator(field);
  const table = new Uint32Array(((parts + 1) * (parts + 2)) / 2);
  /** @param {number} i @param {number} j Steps from corner 0 to corners 1 and 2. */
  const cell = (i, j) => i * (parts + 1) - (i * (i - 1)) / 2 + j;
  /** @param {number} a @param {number} b @param {number} along Steps from a to b. */
  const onEdge = (a, b, along) => {
    const first = /** @type {number} */ (edges.get(Math.min(a, b) * header.vertices + Math.max(a, b)));
    return first + (a < b ? along : parts - along) - 1;
  };
  let next = interior;
  let out = 0;
  for (let face = 0; face < count; face++) {
    const [a, b, c] = [faces[3 * face], faces[3 * face + 1], faces[3 * face + 2]];
    for (let i = 0; i <= parts; i++) {
      for (let j = 0; j <= parts - i; j++) {
        const k = parts - i - j;
        let vertex;
        if (k === parts) vertex = a;
        else if (i === parts) vertex = b;
        else if (j === parts) vertex = c;
        else if (j === 0) vertex = onEdge(a, b, i);
        else if (k === 0) vertex = onEdge(b, c, j);
        else if (i === 0) vertex = onEdge(c, a, k);
        else vertex = next++;
        table[cell(i, j)] = vertex;
        if (!done[vertex]) {
          done[vertex] = 1;
          evaluate(a, b, c, k / parts, i / parts, j / parts, positions, 3 * vertex);
        }
      }
    }
    for (let i = 0; i < parts; i++) {
      for (let j = 0; j < parts - i; j++) {
        indices.set([table[cell(i, j)], table[cell(i + 1, j)], table[cell(i, j + 1)]], out);
        out += 3;
        if (i + j < parts - 1) {
          indices.set([table[cell(i + 1, j)], table[cell(i + 1, j + 1)], table[cell(i, j + 1)]], out);
          out += 3;
        }
      }
    }
  }
  return { positions, indices };
}

/**
 * A function that writes f at one point: three vertices of a face, their weights, and where to write.
 *
 * @param {NeuralField} field
 */
function evaluator({ header, verts, features, layers }) {
  const { features: d, octaves, widths, centre, scale } = header;
  const values = widths.map((/** @type {number} */ width) => new Float64Array(width));
  /**
   * @param {number} a @param {number} b @param {number} c @param {number} wa @param {number} wb @param {number} wc
   * @param {Float32Array} out @param {number} at
   */
  return (a, b, c, wa, wb, wc, out, at) => {
    const input = values[0];
    for (let i = 0; i < d; i++) input[i] = wa * features[a * d + i] + wb * features[b * d + i] + wc * features[c * d + i];
    for (let axis = 0; axis < 3; axis++) {
      const p = wa * verts[3 * a + axis] + wb * verts[3 * b + axis] + wc * verts[3 * c + axis];
      input[d + axis] = p;
      for (let k = 0; k < octaves; k++) {
        const wave = p * 2 ** k * Math.PI;
        input[d + 3 + 6 * k + axis] = Math.sin(wave);
        input[d + 6 + 6 * k + axis] = Math.cos(wave);
      }
    }
    for (let layer = 0; layer < layers.length; layer++) {
      const { weight, bias } = layers[layer];
      const [from, to] = [values[layer], values[layer + 1]];
      for (let row = 0, w = 0; row < to.length; row++) {
        let sum = bias[row];
        for (let i = 0; i < from.length; i++) sum += weight[w++] * from[i];
        to[row] = layer + 1 < layers.length ? sum / (1 + Math.exp(-sum)) : sum; // SiLU
      }
    }
    const moved = values[layers.length];
    for (let axis = 0; axis < 3; axis++) out[at + axis] = centre[axis] + scale * (input[d + axis] + moved[axis]);
  };
}

/**
 * @param {Uint16Array} symbols @param {Uint16Array} steps @param {number} vertices @param {number} count @param {number} bits
 * @returns {{ verts: Float64Array, faces: Uint32Array }}
 */
function decodeBase(symbols, steps, vertices, count, bits) {
  const places = new Int32Array(3 * vertices);
  const faces = new Uint32Array(3 * count);
  /** @type {Map<number, [number, number, number]>} Open edges, oldest first, with the third corner of their face. */
  const open = new Map();
  let [made, done, at] = [0, 0, 0];
  const take = () => {
    if (at >= symbols.length) throw new Error("The .ndf contradicts itself.");
    return symbols[at++];
  };
  /** @param {number} symbol @param {(axis: number) => number} guess */
  const corner = (symbol, guess) => {
    if (symbol > made || (symbol === 0 && made >= vertices)) throw new Error("The .ndf contradicts itself.");
    if (symbol) return made - symbol;
    for (let axis = 0; axis < 3; axis++) {
      const step = steps[3 * made + axis];
      places[3 * made + axis] = guess(axis) + ((step >> 1) ^ -(step & 1));
    }
    return made++;
  };
  /** @param {number} a @param {number} b @param {number} c */
  const add = (a, b, c) => {
    faces.set([a, b, c], 3 * done++);
    for (const [one, other, rest] of [[a, b, c], [b, c, a], [c, a, b]])
      if (!open.delete(other * vertices + one)) open.set(one * vertices + other, [one, other, rest]);
  };
  while (done < count) {
    const first = open.values().next();
    if (first.done) {
      const last = made - 1;
      const a = corner(take(), (axis) => (last < 0 ? 0 : places[3 * last + axis]));
      const b = corner(take(), (axis) => places[3 * a + axis]);
      add(a, b, corner(take(), (axis) => places[3 * b + axis]));
      continue;
    }
    const [a, b, rest] = first.value;
    const symbol = take();
    if (symbol) add(b, a, corner(symbol - 1, (axis) => places[3 * a + axis] + places[3 * b + axis] - places[3 * rest + axis]));
    else open.delete(a * vertices + b); // a border
  }
  const most = 2 ** (bits - 1) - 1;
  return { verts: Float64Array.from(places, (place) => place / most - 1), faces };
}

/**
 * Unpacks a section of 16-bit numbers, whose low bytes come first, then the high ones.
 *
 * @param {Uint8Array} data @param {number} size
 */
async function numbers(data, size) {
  const unpacker = new DecompressionStream("deflate-raw");
  const reader = new Blob([/** @type {BlobPart} */ (data)]).stream().pipeThrough(unpacker).getReader();
  const bytes = new Uint8Array(size);
  let at = 0;
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    if (at + part.value.length > size) throw new Error("A section of the .ndf has another size than stated.");
    bytes.set(part.value, at);
    at += part.value.length;
  }
  if (at !== size) throw new Error("A section of the .ndf has another size than stated.");
  return Uint16Array.from({ length: size / 2 }, (_, i) => bytes[i] | (bytes[size / 2 + i] << 8));
}

/** @param {number} bits A float16. */
function half(bits) {
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  const size = exponent ? 2 ** (exponent - 25) * (1024 + fraction) : 2 ** -24 * fraction;
  return bits & 0x8000 ? -size : size;
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
