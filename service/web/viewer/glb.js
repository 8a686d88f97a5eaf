// @ts-check
/** The GLB container: the JSON chunk read and written, nothing decoded. */

const MAGIC = 0x46546c67; // "glTF"
const JSON_CHUNK = 0x4e4f534a;
const BINARY_CHUNK = 0x004e4942;

/** @param {ArrayBuffer} buffer @returns {boolean} whether it begins as a GLB */
export function isGlb(buffer) {
  return buffer.byteLength >= 20 && new DataView(buffer).getUint32(0, true) === MAGIC;
}

/** Read the JSON of a GLB or a .gltf. @param {ArrayBuffer} buffer @returns {Record<string, any>} @throws {Error} it is neither */
export function readJson(buffer) {
  let bytes = new Uint8Array(buffer);
  if (isGlb(buffer)) {
    const view = new DataView(buffer);
    const length = view.getUint32(12, true);
    if (view.getUint32(16, true) !== JSON_CHUNK || 20 + length > buffer.byteLength) {
      throw new Error("The GLB file is damaged: its first chunk is not JSON.");
    }
    bytes = bytes.subarray(20, 20 + length);
  }
  try {
    return JSON.parse(new TextDecoder().decode(bytes));
  } catch {
    throw new Error("This is not a glTF file: its JSON cannot be read.");
  }
}

/**
 * Replace the JSON; the other chunks stay as they are.
 * @param {ArrayBuffer} buffer a GLB or a .gltf
 * @param {Record<string, any>} json
 * @returns {ArrayBuffer}
 */
export function withJson(buffer, json) {
  if (!isGlb(buffer)) return new TextEncoder().encode(JSON.stringify(json)).buffer;
  return joined(json, [new Uint8Array(buffer, 20 + new DataView(buffer).getUint32(12, true))]);
}

/** A GLB of its JSON and what follows it. @param {Record<string, any>} json @param {Uint8Array[]} rest @returns {ArrayBuffer} */
function joined(json, rest) {
  const text = new TextEncoder().encode(JSON.stringify(json));
  const padded = text.length + ((4 - (text.length % 4)) % 4);
  const length = rest.reduce((sum, chunk) => sum + chunk.length, 20 + padded);
  const out = new Uint8Array(length).fill(0x20, 20, 20 + padded);
  const view = new DataView(out.buffer);
  [MAGIC, 2, length, padded, JSON_CHUNK].forEach((word, i) => view.setUint32(4 * i, word, true));
  out.set(text, 20);
  let at = 20 + padded;
  for (const chunk of rest) {
    out.set(chunk, at);
    at += chunk.length;
  }
  return out.buffer;
}

/** @param {Record<string, any>} json @param {Uint8Array[]} chunks of the binary chunk, each as long as a multiple of four bytes @returns {ArrayBuffer} a GLB */
export function writeGlb(json, chunks) {
  const length = chunks.reduce((sum, chunk) => sum + chunk.length, 0);
  return joined(json, [new Uint8Array(Uint32Array.of(length, BINARY_CHUNK).buffer), ...chunks]);
}

/**
 * The same geometry without materials and images: a result has those of its source, and decoding them again is the
 * larger chunk of the loading time.
 * @param {ArrayBuffer} buffer
 * @returns {ArrayBuffer}
 */
export function withoutMaterials(buffer) {
  const json = readJson(buffer);
  for (const name of ["materials", "textures", "images", "samplers"]) delete json[name];
  for (const mesh of json.meshes ?? []) {
    for (const primitive of mesh.primitives ?? []) {
      delete primitive.material;
      if (primitive.extensions) delete primitive.extensions.KHR_materials_variants;
    }
  }
  return withJson(buffer, json);
}
