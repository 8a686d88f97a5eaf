// @ts-check
/**
 * A shape of which only the vertices are fetched: a result has the faces, the texture coordinates and the pictures of its source, which are
 * here already. Nothing is rounded: the numbers are those of the file.
 */
import { place, primitivesOf } from "./blend-glb.js";
import { isGlb, readJson, withJson } from "./glb.js";

const HEAD = 65_536; // bytes: mostly all of the JSON
const GAP = 65_536; // bytes between two ranges that are fetched as one
const MOST_RANGES = 8;
const WORTH = 0.7; // of a file; more of it is fetched whole
const MOVED = ["POSITION", "NORMAL", "TANGENT"];
const WHOLE = new Error("The file is fetched whole.");

/** @typedef {{ index: number, other: number }} Move An accessor of the source, and the one of the shape that takes its place. */
/** @typedef {{ start: number, end: number }} Range Bytes [start, end) of the shape's file. */

/**
 * @param {ArrayBuffer} source a GLB
 * @param {(range: Range) => Promise<{ bytes: Uint8Array, size: number }>} fetchRange bytes of the shape's file, and how large it is
 * @returns {Promise<ArrayBuffer | null>} The source's file with the shape's vertices; null where the two files do not fit, or little is saved.
 */
export async function movedGlb(source, fetchRange) {
  if (!isGlb(source)) return null;
  const head = await fetchRange({ start: 0, end: HEAD });
  if (!isGlb(copyOf(head.bytes))) return null;
  const end = 28 + new DataView(head.bytes.buffer, head.bytes.byteOffset).getUint32(12, true);
  const rest = end > head.bytes.length ? (await fetchRange({ start: head.bytes.length, end })).bytes : new Uint8Array();
  // As long as the file, but empty where nothing was fetched.
  const shape = new ArrayBuffer(head.size);
  const bytes = new Uint8Array(shape);
  bytes.set(head.bytes);
  bytes.set(rest, head.bytes.length);
  try {
    const [before, after] = [readJson(source), readJson(shape)];
    const moves = movesOf(before, after);
    const ranges = merged(moves.map(({ other }) => rangeOf(shape, after, other)));
    const needed = ranges.reduce((sum, range) => sum + range.end - range.start, end);
    if (ranges.length > MOST_RANGES || needed > WORTH * head.size) return null;
    await Promise.all(ranges.map(async (range) => bytes.set((await fetchRange(range)).bytes, range.start)));
    return taken(source, before, shape, after, moves);
  } catch (error) {
    if (error === WHOLE || (error instanceof Error && error.message.startsWith("The file is compressed"))) return null;
    throw error;
  }
}

/** @param {Uint8Array} bytes @returns {ArrayBuffer} */
function copyOf(bytes) {
  return /** @type {ArrayBuffer} */ (bytes.slice().buffer);
}

/** Which accessors move; throws where the files are not alike. @param {Record<string, any>} before @param {Record<string, any>} after @returns {Move[]} */
function movesOf(before, after) {
  const [own, others] = [primitivesOf(before), primitivesOf(after)];
  if (own.length !== others.length) throw WHOLE;
  /** @type {Map<number, number>} */
  const moves = new Map();
  own.forEach((primitive, i) => {
    const other = others[i];
    if (primitive.indices === undefined ? other.indices !== undefined : !alike(before, primitive.indices, after, other.indices, ["count"])) throw WHOLE;
    for (const name of MOVED) {
      const [index, found] = [primitive.attributes[name], other.attributes[name]];
      if (index === undefined) continue;
      if (!alike(before, index, after, found, ["count", "type", "componentType", "normalized"])) throw WHOLE;
      // Vertices of two nodes that have come to lie in different places.
      if ((moves.get(index) ?? found) !== found) throw WHOLE;
      moves.set(index, found);
    }
  });
  return [...moves].map(([index, other]) => ({ index, other }));
}

/** @param {Record<string, any>} before @param {number} index @param {Record<string, any>} after @param {number | undefined} other @param {string[]} names */
function alike(before, index, after, other, names) {
  return other !== undefined && names.every((name) => before.accessors[index][name] === after.accessors[other][name]);
}

/** @param {ArrayBuffer} file @param {Record<string, any>} json @param {number} index @returns {Range} */
function rangeOf(file, json, index) {
  const { start, stride, size } = place(file, json, index);
  return { start, end: start + (json.accessors[index].count - 1) * stride + size };
}

/** @param {Range[]} ranges @returns {Range[]} rising, those that are near each other as one */
function merged(ranges) {
  /** @type {Range[]} */
  const out = [];
  for (const { start, end } of ranges.sort((a, b) => a.start - b.start)) {
    const last = out.at(-1);
    if (last && start <= last.end + GAP) last.end = Math.max(last.end, end);
    else out.push({ start, end });
  }
  return out;
}

/**
 * @param {ArrayBuffer} source @param {Record<string, any>} before @param {ArrayBuffer} shape @param {Record<string, any>} after @param {Move[]} moves
 * @returns {ArrayBuffer}
 */
function taken(source, before, shape, after, moves) {
  const file = source.slice(0);
  const [to, from] = [new Uint8Array(file), new Uint8Array(shape)];
  for (const { index, other } of moves) {
    const [into, out] = [place(file, before, index), place(shape, after, other)];
    const { count } = before.accessors[index];
    if (into.stride === into.size && out.stride === out.size) to.set(from.subarray(out.start, out.start + count * out.size), into.start);
    else for (let i = 0; i < count; i++) to.set(from.subarray(out.start + i * out.stride, out.start + i * out.stride + out.size), into.start + i * into.stride);
    const { min, max } = after.accessors[other];
    if (min && max) Object.assign(before.accessors[index], { min, max });
  }
  return withJson(file, before);
}
