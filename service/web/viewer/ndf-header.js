// @ts-check
/**
 * Checks what the header of a `.ndf` states before anything is made of it. The counterpart in Python is `meshdeform/kinds/surface_fit/ndf_header.py`; a
 * test compares the two. A checksum does not make a file honest: sizes and widths are used only where they fit each other and the limits.
 */
export const TORN = "The .ndf contradicts itself.";

const MAX_FACES = 100_000;
const [MAX_BITS, MAX_OCTAVES, MAX_LAYERS, MAX_SCALARS] = [16, 32, 32, 64];
const MAX_STEP = 400; // of the exponents n: 2^(n / 4) is 1e30 at most
const MAX_UNPACKED = 2 ** 26; // of all sections; those of 16,000 faces, 32 features and 64 scalars take less than 10 MB

/** @param {any} header @param {number} size The bytes of all sections. @throws {Error} */
export function checkHeader(header, size) {
  const { vertices, faces, features, octaves, bits, centre, scale, widths, sections, scalars = [] } = header ?? {};
  if (!(whole(faces, 1, MAX_FACES) && whole(vertices, 1, 3 * faces))) throw new Error("The .ndf states impossible counts.");
  require(whole(features, 0, 1024) && whole(octaves, 0, MAX_OCTAVES) && whole(bits, 2, MAX_BITS));
  require(numbers(centre, 3) && Number.isFinite(scale) && Array.isArray(scalars) && scalars.length <= MAX_SCALARS);
  const sizes = [weightsOf(header, features, vertices)];
  require(widths[0] === features + 3 + 6 * octaves && widths.at(-1) === 3);
  for (const each of scalars) {
    sizes.push(weightsOf(each, each?.widths?.[0], vertices));
    const outputs = each.widths.at(-1);
    const { labels = [] } = each;
    require(numbers(each.offset, outputs) && numbers(each.scale, outputs) && (numbers(labels, 0) || numbers(labels, outputs)));
  }
  require(Array.isArray(sections) && sections.length === 2 + sizes.length);
  require(sections.every((/** @type {any} */ pair) => numbers(pair, 2) && whole(pair[0], 0, size)));
  const [packed, unpacked] = [0, 1].map((i) => sections.map((/** @type {number[]} */ pair) => pair[i]));
  const sum = (/** @type {number[]} */ list) => list.reduce((one, other) => one + other, 0);
  // A face has one symbol, each of its borders one more, and each part three.
  require(whole(unpacked[0], 2, 14 * faces) && unpacked[0] % 2 === 0);
  require([6 * vertices, ...sizes].every((wanted, i) => unpacked[i + 1] === wanted));
  require(sum(packed) === size && sum(unpacked) <= MAX_UNPACKED);
}

/** The bytes of a network's section. @param {any} network @param {number} features @param {number} vertices */
function weightsOf(network, features, vertices) {
  const { widths, steps } = network ?? {};
  require(Array.isArray(widths) && widths.length >= 2 && widths.length <= MAX_LAYERS && widths.every((width) => whole(width, 1, 65_536)));
  require(numbers(steps, features + 2 * widths.length - 2));
  require(steps.every((/** @type {number} */ step) => whole(step, -MAX_STEP, MAX_STEP)));
  let count = vertices * features;
  for (let i = 1; i < widths.length; i++) count += (widths[i - 1] + 1) * widths[i];
  return 2 * count;
}

/** @param {unknown} number @param {number} least @param {number} most */
function whole(number, least, most) {
  return Number.isInteger(number) && Number(number) >= least && Number(number) <= most;
}

/** Whether a list has so many finite numbers. @param {unknown} list @param {number} count */
function numbers(list, count) {
  return Array.isArray(list) && list.length === count && list.every(Number.isFinite);
}

/** @param {boolean} fits */
function require(fits) {
  if (!fits) throw new Error(TORN);
}
