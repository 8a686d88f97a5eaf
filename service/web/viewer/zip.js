// @ts-check
/**
 * Show an asset that comes in a ZIP, or whose images are in other files. The server reads ZIPs by the same rules and refuses what is wrong; here a file that
 * cannot be read is only not shown.
 */
import { binaryChunk, isGlb, readJson, writeGlb } from "./glb.js";

const ENTRY = 0x02014b50;
const END = 0x06054b50;
const MOST_BYTES = 1 << 29;
const KINDS = [["glb", "gltf"], ["obj"], ["ply"], ["stl"]];
const TYPES = /** @type {Record<string, string>} */ ({ png: "image/png", jpg: "image/jpeg", jpeg: "image/jpeg", webp: "image/webp", ktx2: "image/ktx2" });

/** @typedef {{method: number, start: number, packed: number, size: number}} Entry */

/**
 * What the viewer can read of a file: the asset inside a ZIP, any other file as it is.
 * @param {ArrayBuffer} buffer
 * @param {string} format
 * @returns {Promise<{buffer: ArrayBuffer, format: string}>} of a glTF with its files a GLB; an OBJ without its materials
 * @throws {Error} the message is for people
 */
export async function unpacked(buffer, format) {
  if (format !== "zip") return { buffer: isGlb(buffer) && hasLinks(buffer) ? await embedded(buffer, async () => null) : buffer, format };
  const entries = listed(buffer);
  const main = KINDS.map((endings) => [...entries.keys()].filter((name) => endings.includes(ending(name)))).find((names) => names.length);
  if (!main) throw new Error("The ZIP holds no GLB, glTF, OBJ, PLY or STL.");
  if (main.length > 1) throw new Error(`The ZIP holds several assets: ${main.slice(0, 3).join(", ")}.`);
  const data = await content(buffer, /** @type {Entry} */ (entries.get(main[0])));
  if (!["glb", "gltf"].includes(ending(main[0]))) return { buffer: data, format: ending(main[0]) };
  return { buffer: await embedded(data, reader(buffer, entries, main[0])), format: "glb" };
}

/** @param {ArrayBuffer} glb @returns {boolean} whether images of it are in other files, and all buffers inside */
function hasLinks(glb) {
  const { buffers = [], images = [] } = readJson(glb);
  const outside = (/** @type {any} */ { uri }) => typeof uri === "string" && !/^data:/i.test(uri);
  return images.some(outside) && !buffers.some(outside);
}

/**
 * The files of a ZIP, each unpacked when it is asked for.
 * @param {ArrayBuffer} buffer
 * @returns {Map<string, () => Promise<ArrayBuffer>>} by name, in the ZIP's order
 * @throws {Error} the message is for people
 */
export function filesOf(buffer) {
  return new Map([...listed(buffer)].map(([name, entry]) => [name, () => content(buffer, entry)]));
}

/** @param {ArrayBuffer} buffer @returns {Map<string, Entry>} files by name */
function listed(buffer) {
  const view = new DataView(buffer);
  let end = buffer.byteLength - 22;
  while (end >= 0 && view.getUint32(end, true) !== END) end--;
  if (end < 0) throw new Error("The ZIP is cut off or damaged.");
  /** @type {Map<string, Entry>} */
  const found = new Map();
  let at = view.getUint32(end + 16, true);
  let total = 0;
  for (let count = view.getUint16(end + 10, true); count > 0; count--) {
    if (at + 46 > buffer.byteLength || view.getUint32(at, true) !== ENTRY) throw new Error("The ZIP is cut off or damaged.");
    const [names, extra, comment] = [28, 30, 32].map((place) => view.getUint16(at + place, true));
    const name = new TextDecoder().decode(new Uint8Array(buffer, at + 46, names)).replaceAll("\\", "/");
    const header = view.getUint32(at + 42, true);
    const size = view.getUint32(at + 24, true);
    total += size;
    if (total > MOST_BYTES) throw new Error("The ZIP unpacks to more than this page shows.");
    if (!name.endsWith("/") && !name.startsWith("__MACOSX/")) {
      const start = header + 30 + view.getUint16(header + 26, true) + view.getUint16(header + 28, true);
      found.set(normal(name), { method: view.getUint16(at + 10, true), start, packed: view.getUint32(at + 20, true), size });
    }
    at += 46 + names + extra + comment;
  }
  return found;
}

/** @param {ArrayBuffer} buffer @param {Entry} entry @returns {Promise<ArrayBuffer>} */
async function content(buffer, { method, start, packed, size }) {
  const bytes = new Uint8Array(buffer, start, packed);
  if (method === 0) return bytes.slice().buffer;
  if (method !== 8) throw new Error("The ZIP is compressed by a method that this page cannot read.");
  const out = new Uint8Array(size);
  let at = 0;
  const reader = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw")).getReader();
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    if (at + part.value.length > size) throw new Error("The ZIP is damaged.");
    out.set(part.value, at);
    at += part.value.length;
  }
  return out.buffer;
}

/**
 * A glTF with the buffers and images that it refers to, as a GLB; images that are missing become white.
 * @param {ArrayBuffer} asset
 * @param {(uri: string) => Promise<ArrayBuffer | null>} read
 * @returns {Promise<ArrayBuffer>}
 * @throws {Error} a buffer is missing
 */
async function embedded(asset, read) {
  const json = readJson(asset);
  /** @type {Uint8Array[]} */
  const parts = [];
  let length = 0;
  const add = (/** @type {Uint8Array} */ data) => {
    const at = length;
    const padded = new Uint8Array(data.length + ((4 - (data.length % 4)) % 4));
    padded.set(data);
    parts.push(padded);
    length += padded.length;
    return at;
  };
  /** @type {any[]} buffers without data, which compressed views may name */
  const empty = [];
  const places = [];
  for (const [index, buffer] of (json.buffers ?? []).entries()) {
    const data = buffer.uri ? await linked(buffer.uri, read) : index === 0 && isGlb(asset) ? binaryChunk(asset) : null;
    if (!data && buffer.uri) throw new Error(`The ZIP lacks ${buffer.uri}.`);
    places.push(data ? { buffer: 0, at: add(data) } : { buffer: empty.push(buffer), at: 0 });
  }
  const move = (/** @type {any} */ view) => {
    const place = places[view.buffer];
    if (place) Object.assign(view, { buffer: place.buffer, byteOffset: (view.byteOffset ?? 0) + place.at });
  };
  json.bufferViews ??= [];
  for (const view of json.bufferViews) {
    move(view);
    for (const name of ["EXT_meshopt_compression", "KHR_meshopt_compression"]) if (view.extensions?.[name]) move(view.extensions[name]);
  }
  for (const image of json.images ?? []) {
    if (!image.uri) continue;
    const data = await linked(image.uri, read);
    image.mimeType ??= (data && TYPES[ending(image.uri)]) ?? "image/png";
    image.bufferView = json.bufferViews.push({ buffer: 0, byteOffset: add(data ?? WHITE), byteLength: (data ?? WHITE).length }) - 1;
    delete image.uri;
  }
  json.buffers = [{ byteLength: length }, ...empty];
  return writeGlb(json, parts);
}

/** A picture of one white pixel. */
const WHITE = fromBase64("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mP4DwABAQEAHLCMmQAAAABJRU5ErkJggg==");

/** @param {string} uri @param {(uri: string) => Promise<ArrayBuffer | null>} read @returns {Promise<Uint8Array | null>} */
async function linked(uri, read) {
  const inline = /^data:[^,]*;base64,/i.exec(uri);
  if (inline) return fromBase64(uri.slice(inline[0].length));
  const data = await read(uri);
  return data && new Uint8Array(data);
}

/** @param {string} text */
function fromBase64(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

/** @param {ArrayBuffer} zip @param {Map<string, Entry>} entries @param {string} main */
function reader(zip, entries, main) {
  const folder = main.slice(0, main.lastIndexOf("/") + 1);
  return async (/** @type {string} */ uri) => {
    const names = [uri, decoded(uri)].map((link) => normal(folder + link.replaceAll("\\", "/")));
    const exact = names.find((name) => entries.has(name));
    const alike = [...entries.keys()].filter((name) => names.some((wanted) => wanted.toLowerCase() === name.toLowerCase()));
    const entry = entries.get(exact ?? (alike.length === 1 ? alike[0] : ""));
    return entry ? content(zip, entry) : null;
  };
}

/** @param {string} name */
function ending(name) {
  return name.toLowerCase().split(".").pop() ?? "";
}

/** @param {string} uri */
function decoded(uri) {
  try {
    return decodeURIComponent(uri);
  } catch {
    return uri;
  }
}

/** @param {string} path @returns {string} without "." and ".." */
function normal(path) {
  /** @type {string[]} */
  const parts = [];
  for (const part of path.split("/")) {
    if (part === "..") parts.pop();
    else if (part && part !== ".") parts.push(part);
  }
  return parts.join("/");
}
