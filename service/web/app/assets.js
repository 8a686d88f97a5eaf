// @ts-check
/** The file that a job deforms, and its upload: once, however many requests use it. */
import { address, requestJson } from "./api.js";

// Smaller files go along with each request; larger ones are uploaded once and then named.
const SMALL_BYTES = 1 << 20;
export const FORMATS = ["glb", "obj", "ply", "stl", "zip"];

/** @param {string} name */
export function formatOf(name) {
  const ending = name.toLowerCase().split(".").pop() ?? "";
  return FORMATS.includes(ending) || ending === "gltf" ? ending : "";
}

export class Asset {
  /**
   * @param {Blob} blob
   * @param {string} name
   */
  constructor(blob, name) {
    this.blob = blob;
    this.name = name;
    this.size = blob.size;
    this.format = formatOf(name);
    /** @type {Promise<string> | null} */
    this._upload = null;
  }

  bytes() {
    return this.blob.arrayBuffer();
  }

  /**
   * What to send with a document, as `POST /v1/jobs` wants it.
   *
   * @param {Record<string, any>} document
   * @param {Record<string, Asset>} [others] More files, by the names of their parts.
   * @returns {Promise<{json?: any, body?: FormData}>}
   */
  async submission(document, others = {}) {
    const all = Object.entries({ asset: /** @type {Asset} */ (this), ...others });
    const large = all.some(([, { size }]) => size > SMALL_BYTES);
    const uploads = large ? await Promise.all(all.map(([, file]) => file._uploaded())) : [];
    if (large && uploads.every(Boolean)) return { json: { ...document, files: Object.fromEntries(all.map(([part], i) => [part, { upload_id: uploads[i] }])) } };
    const body = new FormData();
    body.append("request", JSON.stringify(document));
    for (const [part, file] of all) body.append(part, file.blob, file.name);
    return { body };
  }

  /** Upload the file again with the next request: the server may have deleted an unused upload. */
  forgetUpload() {
    this._upload = null;
  }

  /** @returns {Promise<string>} The upload's id; empty if this browser or server does not support uploads. */
  _uploaded() {
    this._upload ??= upload(this).catch((error) => {
      this._upload = null;
      throw error;
    });
    return this._upload;
  }
}

/** @param {Asset} asset */
async function upload(asset) {
  // Without TLS, except on this machine, browsers have no SHA-256.
  if (!globalThis.crypto?.subtle) return "";
  const sha256 = hex(await crypto.subtle.digest("SHA-256", await asset.bytes()));
  const json = { filename: asset.name, size: asset.size, sha256 };
  const made = await requestJson("v1/uploads", { method: "POST", json });
  // A bucket is another origin, which the page's policy keeps it from: then the file goes through the API.
  if (!made.url || !String(made.url).startsWith("/")) return "";
  const sent = await fetch(address(made.url), { method: made.method ?? "PUT", headers: made.headers, body: asset.blob });
  if (!sent.ok) return "";
  await requestJson(`v1/uploads/${made.id}/complete`, { method: "POST", json: { sha256 } });
  return String(made.id);
}

/**
 * One of the assets that come with the page. They need no API key.
 *
 * @param {string} name Of a file below `web/examples/`.
 * @param {AbortSignal} signal
 * @returns {Promise<Asset>}
 */
export async function exampleAsset(name, signal) {
  const response = await fetch(address(`web/examples/${name}`), { signal });
  if (!response.ok) throw new Error(`The server answered ${response.status}.`);
  return new Asset(await response.blob(), name.split("/").pop() ?? name);
}

/** @param {ArrayBuffer} digest */
function hex(digest) {
  return [...new Uint8Array(digest)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}
