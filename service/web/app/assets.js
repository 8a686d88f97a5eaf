// @ts-check
/** The file that a job deforms, and its upload: once, however many requests use it. */
import { client, MeshdeformError } from "./client.js";

// Smaller files go along with each request; larger ones are uploaded once and then named.
const SMALL_BYTES = 64 << 10;
// Without TLS, except on this machine, browsers have no SHA-256; and a bucket is another host.
const NO_UPLOAD = ["checksum_unavailable", "upload_elsewhere"];
export const FORMATS = ["glb", "obj", "ply", "stl", "zip"];
/** What describes a surface: also 3MF, which is not drawn here, points, grids and networks. */
export const SURFACE_FORMATS = [...FORMATS, "3mf", "xyz", "npz", "safetensors"];

/** @param {string} name @param {string[]} [formats] */
export function formatOf(name, formats = FORMATS) {
  const ending = name.toLowerCase().split(".").pop() ?? "";
  return formats.includes(ending) || ending === "gltf" ? ending : "";
}

export class Asset {
  /** @param {Blob} blob @param {string} name */
  constructor(blob, name) {
    this.blob = blob;
    this.name = name;
    this.size = blob.size;
    this.format = formatOf(name, SURFACE_FORMATS);
    /** What is sent: the file, or its upload. @type {Promise<any> | null} */
    this._sent = null;
    /** What tells its bytes from those of another file, once it has learnt it. */
    this.print = "";
    /** Its SHA-256 where the server keeps it for previews; empty: it does not. */
    this.kept = "";
    /** Called with the share of the file that has been uploaded. @type {(share: number) => void} */
    this.onProgress = () => {};
  }

  bytes() {
    return this.blob.arrayBuffer();
  }

  /** Learn `print`, by FNV-1a, which browsers allow without TLS, too. */
  async learn() {
    if (this.print) return;
    let hash = 0x811c9dc5;
    for (const byte of new Uint8Array(await this.bytes())) hash = Math.imul(hash ^ byte, 0x01000193);
    this.print = `${this.size}-${(hash >>> 0).toString(16)}`;
  }

  /** @returns {Promise<boolean>} whether it has triangles that a view can show: points, grids and networks have none */
  async drawn() {
    if (!FORMATS.includes(this.format)) return false;
    if (this.format !== "ply") return true;
    const header = await this.blob.slice(0, 65_536).text();
    return !header.startsWith("ply") || /^element\s+(face|tristrips)\s+[1-9]/m.test(header.split("end_header")[0]);
  }

  /**
   * What the client takes for a job on this file: `client.submit(...(await asset.submission(document)))`.
   * @param {Record<string, any>} document
   * @param {Record<string, Asset>} [others] More files, by their names in the job.
   * @param {AbortSignal} [signal] Of the request; an upload goes on, for the requests that follow.
   * @returns {Promise<[any, any, {files: Record<string, any>, signal?: AbortSignal}]>}
   */
  async submission(document, others = {}, signal) {
    const all = Object.entries({ asset: /** @type {Asset} */ (this), ...others });
    const large = all.some(([, { size }]) => size > SMALL_BYTES);
    const sent = await Promise.all(all.map(async ([name, file]) => [name, large ? await file._uploaded() : file._file()]));
    const { asset, ...files } = Object.fromEntries(sent);
    return [asset, document, { files, signal }];
  }

  /** Upload the file again with the next request: the server may have deleted an unused upload. */
  forgetUpload() {
    this._sent = null;
  }

  /** @returns {File} */
  _file() {
    return new File([this.blob], this.name, { type: this.blob.type });
  }

  /** @returns {Promise<any>} The upload; the file if this browser or server does not support uploads. */
  _uploaded() {
    this._sent ??= client.upload(this._file(), { onProgress: (bytes) => this.onProgress(bytes / this.size) }).catch((error) => {
      if (error instanceof MeshdeformError && NO_UPLOAD.includes(error.code)) return this._file();
      this._sent = null;
      throw error;
    });
    return this._sent;
  }
}

/** @param {string} base64 @returns {Uint8Array<ArrayBuffer>} */
export function bytesOf(base64) {
  return Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
}

/**
 * One of the assets that come with the page. They need no API key.
 * @param {string} name Of a file below `web/examples/`.
 * @param {AbortSignal} signal
 * @returns {Promise<Asset>}
 */
export async function exampleAsset(name, signal) {
  const response = await client.request(`web/examples/${name}`, { signal });
  return new Asset(await response.blob(), name.split("/").pop() ?? name);
}
