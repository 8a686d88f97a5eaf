// @ts-check
/** An asset that comes in a ZIP. The server reads ZIPs by the same rules and refuses what is wrong; here it is only not shown. */
import { unzipSync } from "../vendor/three/addons/libs/fflate.module.js";

const MOST_BYTES = 1 << 29;
const KINDS = [["glb", "gltf"], ["obj"], ["ply"], ["stl"]];

/** @param {ArrayBuffer} buffer @returns {Map<string, Uint8Array<ArrayBuffer>>} its files by name @throws {Error} the message is for people */
export function filesOf(buffer) {
  let total = 0;
  const filter = (/** @type {{ name: string, originalSize: number }} */ { name, originalSize }) => {
    total += originalSize;
    return total <= MOST_BYTES && !name.endsWith("/") && !name.startsWith("__MACOSX/");
  };
  try {
    const files = Object.entries(unzipSync(new Uint8Array(buffer), { filter }));
    return new Map(files.map(([name, data]) => [resolved(name), /** @type {Uint8Array<ArrayBuffer>} */ (data)]));
  } catch (error) {
    throw new Error("The ZIP is cut off or damaged.", { cause: error });
  } finally {
    if (total > MOST_BYTES) throw new Error("The ZIP unpacks to more than this page shows.");
  }
}

/**
 * @param {ArrayBuffer} buffer
 * @returns {{ buffer: ArrayBuffer, format: string, linked: (uri: string) => Uint8Array<ArrayBuffer> | undefined }} the asset, and the
 *   files to which it may refer
 * @throws {Error} the message is for people
 */
export function assetIn(buffer) {
  const files = filesOf(buffer);
  const main = KINDS.map((endings) => [...files.keys()].filter((name) => endings.includes(ending(name)))).find((names) => names.length);
  if (!main) throw new Error("The ZIP holds no GLB, glTF, OBJ, PLY or STL.");
  if (main.length > 1) throw new Error(`The ZIP holds several assets: ${main.slice(0, 3).join(", ")}.`);
  const [name] = main;
  const folder = name.slice(0, name.lastIndexOf("/") + 1);
  const linked = (/** @type {string} */ uri) => {
    const names = [uri, unescaped(uri)].map((link) => resolved(folder + link));
    const alike = [...files.keys()].filter((known) => names.some((wanted) => wanted.toLowerCase() === known.toLowerCase()));
    return files.get(names.find((wanted) => files.has(wanted)) ?? (alike.length === 1 ? alike[0] : ""));
  };
  return { buffer: /** @type {Uint8Array<ArrayBuffer>} */ (files.get(name)).buffer, format: ending(name), linked };
}

/** @param {string} name */
function ending(name) {
  return name.toLowerCase().split(".").pop() ?? "";
}

/** @param {string} uri */
function unescaped(uri) {
  try {
    return decodeURIComponent(uri);
  } catch {
    return uri;
  }
}

/** @param {string} path @returns {string} without "." and ".." */
function resolved(path) {
  /** @type {string[]} */
  const segments = [];
  for (const segment of path.replaceAll("\\", "/").split("/")) {
    if (segment === "..") segments.pop();
    else if (segment && segment !== ".") segments.push(segment);
  }
  return segments.join("/");
}
