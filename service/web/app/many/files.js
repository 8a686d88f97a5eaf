// @ts-check
/**
 * The assets among what was chosen or dropped: files, folders and ZIPs, each with the files that it names. Nothing is
 * sent, and nothing larger than the limits is unpacked.
 *
 * @typedef {import("../picking.js").Found} Found
 * @typedef {{path: string, asset: Asset}} Read An asset, and where it lay.
 * @typedef {{assets: Read[], left: string[]}} Sorted `left` says in sentences what was not taken.
 */
import { zip } from "../../client/meshes.js";
import { Asset, FORMATS, formatOf } from "../assets.js";
import { bytes, count, counted } from "../format.js";

/** How much one page holds. */
export const MOST_FILES = 100;
export const MOST_BYTES = 1 << 29;
const HIDDEN = /(^|\/)(\.|__MACOSX\/|Thumbs\.db$)/;
/** What refers to other files by their names. */
const NAMING = /\.(gltf|obj|mtl)$/i;
const LARGEST_NAMING = 1 << 26;

/** @param {Found[]} given @param {Read[]} [known] Those that there are already. @returns {Promise<Sorted>} */
export async function sorted(given, known = []) {
  /** @type {string[]} */
  const left = [];
  const files = await unpacked(given.filter(({ path }) => !HIDDEN.test(path)), left);
  const mains = files.filter(({ path }) => isAsset(path)).sort((a, b) => a.path.localeCompare(b.path, "en", { numeric: true }));
  const used = new Set(mains);
  let size = known.reduce((sum, { asset }) => sum + asset.size, 0);
  /** @type {Read[]} */
  const assets = [];
  let more = 0;
  for (const main of mains) {
    if (known.length + assets.length >= MOST_FILES || size + main.blob.size > MOST_BYTES) more += 1;
    else {
      const others = await companions(main, files);
      others.forEach((file) => used.add(file));
      assets.push({ path: main.path, asset: await together(main, others) });
      size += assets[assets.length - 1].asset.size;
    }
  }
  if (more) left.push(`${counted(more, "more asset")} left out: one page holds ${MOST_FILES}, and ${bytes(MOST_BYTES)}.`);
  const others = files.length - used.size;
  if (others && assets.length) left.push(`${counted(others, "other file")} left out.`);
  if (!mains.length && !left.length) left.push(`No asset among ${given.length === 1 ? given[0].path : `these ${count(given.length)} files`}. Use GLB, glTF, OBJ, PLY or STL, or a ZIP or folder of them.`);
  return { assets, left };
}

/** @param {string} path */
function isAsset(path) {
  const format = formatOf(path);
  return format === "zip" || format === "gltf" || FORMATS.includes(format);
}

/** The files, and in place of each ZIP with several assets what it holds. @param {Found[]} files @param {string[]} left */
async function unpacked(files, left) {
  /** @type {Found[]} */
  const all = [];
  for (const file of files) {
    if (formatOf(file.path) !== "zip") {
      all.push(file);
      continue;
    }
    try {
      if (file.blob.size > MOST_BYTES) throw new Error(`The ZIP is larger than ${bytes(MOST_BYTES)}.`);
      const { filesOf } = await import("../../viewer/zip.js");
      const inside = [...filesOf(await file.blob.arrayBuffer())].filter(([name]) => !HIDDEN.test(name));
      const several = inside.filter(([name]) => isAsset(name)).length > 1;
      const folder = file.path.replace(/\.zip$/i, "");
      if (several) all.push(...inside.map(([name, data]) => ({ path: `${folder}/${name}`, blob: new Blob([data]) })));
      else all.push(file);
    } catch (error) {
      left.push(`${file.path}: ${error instanceof Error ? error.message : error}`);
    }
  }
  return all;
}

/** The files that an asset names, and those that they name. @param {Found} main @param {Found[]} files @returns {Promise<Found[]>} */
async function companions(main, files) {
  const folder = main.path.slice(0, main.path.lastIndexOf("/") + 1);
  const near = files.filter((file) => file !== main && file.path.startsWith(folder) && !isAsset(file.path));
  /** @type {Set<Found>} */
  const named = new Set();
  const ask = [main];
  for (const file of ask) {
    if (!near.length || !NAMING.test(file.path) || file.blob.size > LARGEST_NAMING) continue;
    const text = await file.blob.text();
    for (const other of near) {
      const name = other.path.split("/").pop() ?? "";
      if (named.has(other) || !(text.includes(name) || text.includes(encodeURIComponent(name)))) continue;
      named.add(other);
      ask.push(other);
    }
  }
  return [...named];
}

/** @param {Found} main @param {Found[]} others @returns {Promise<Asset>} one file of all */
async function together(main, others) {
  const folder = main.path.lastIndexOf("/") + 1;
  const name = main.path.slice(folder);
  if (!others.length) return new Asset(main.blob, name);
  const files = await Promise.all([main, ...others].map(async ({ path, blob }) => ({ name: path.slice(folder), bytes: new Uint8Array(await blob.arrayBuffer()) })));
  return new Asset(zip(files), `${name.replace(/\.[^.]*$/, "")}.zip`);
}

/**
 * Files as one ZIP, which is written piece by piece.
 * @param {AsyncIterable<{name: string, blob: Blob}>} files Their names differ.
 * @returns {Promise<Blob>}
 */
export async function archiveOf(files) {
  const { Zip, ZipPassThrough } = await import("../../vendor/three/addons/libs/fflate.module.js");
  /** @type {Blob[]} */
  const pieces = [];
  const archive = new Zip((/** @type {Error | null} */ error, /** @type {Uint8Array<ArrayBuffer>} */ piece) => {
    if (error) throw error;
    pieces.push(new Blob([piece])); // which a browser may keep on the disk
  });
  for await (const { name, blob } of files) {
    const entry = new ZipPassThrough(name);
    archive.add(entry);
    entry.push(new Uint8Array(await blob.arrayBuffer()), true);
  }
  archive.end();
  return new Blob(pieces, { type: "application/zip" });
}
