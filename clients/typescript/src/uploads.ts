/** Files that are sent ahead of their jobs, in pieces that can be resumed. */
import { MeshdeformError } from "./errors.js";
import { newKey, type Transport, worthRetrying } from "./transport.js";
import type { Upload } from "./types.js";

/** The first piece and the largest one; on a fast line each is twice the one before, so that progress is told on slow ones. */
const FIRST_PIECE_BYTES = 64 << 10;
const PIECE_BYTES = 8 << 20;
const PIECE_MS = 1000;

export interface UploadOptions {
  filename?: string;
  signal?: AbortSignal;
  /** Called with the number of bytes that the service has, first with those that it has from before. */
  onProgress?: (bytes: number) => void;
  /** A file with the same key is sent once, and continues where it stopped, also in another process. Default: its name and SHA-256. */
  idempotencyKey?: string;
}

/** Upload a file completely; the service verifies its SHA-256. A file that it has from the last day is not sent again. */
export async function upload(transport: Transport, file: Blob, filename: string, options: UploadOptions): Promise<Upload> {
  const { signal } = options;
  const sha256 = await digest(file);
  const made = await announced(transport, { filename, size: file.size, sha256 }, options);
  if (made.state === "complete") return made;
  if (!transport.directUploads && !transport.isOwn(made.url ?? "")) {
    const detail = "The service takes uploads at another host.";
    throw new MeshdeformError(0, { code: "upload_elsewhere", detail, advice: "Send the file with its job, or allow direct uploads." });
  }
  if (made.resumable) await pieces(transport, file, made, options);
  else {
    await transport.request(made.url ?? "", { method: made.method ?? "PUT", headers: made.headers ?? {}, body: file, signal, signed: true });
    options.onProgress?.(file.size);
  }
  return transport.json<Upload>(`v1/uploads/${made.id}/complete`, { method: "POST", json: { sha256 }, signal });
}

/** The upload of a file as it is now: the one that was made for it before, or a new one. */
async function announced(transport: Transport, json: { filename: string; size: number; sha256: string }, { signal, idempotencyKey }: UploadOptions): Promise<Upload> {
  const key = idempotencyKey ?? `${json.sha256}/${encodeURIComponent(json.filename).slice(0, 150)}`;
  for (const name of [key, newKey()]) {
    const response = await transport.request("v1/uploads", { method: "POST", json, headers: { "Idempotency-Key": name }, signal });
    const made = (await response.json()) as Upload;
    if (!response.headers.has("Idempotency-Replayed")) return made;
    // The first answer again: bytes may have come since, its URL may have expired, or it was deleted.
    const now = await current(transport, made.id, signal).catch((failure) => {
      if (failure instanceof MeshdeformError && failure.status === 404) return null;
      throw failure;
    });
    if (now) return now;
  }
  throw new MeshdeformError(0, { code: "unavailable", detail: "The service has forgotten the upload." });
}

async function pieces(transport: Transport, file: Blob, made: Upload, { signal, onProgress }: UploadOptions): Promise<void> {
  const patience = transport.patience();
  let offset = made.offset;
  let size = FIRST_PIECE_BYTES;
  onProgress?.(offset);
  while (offset < file.size) {
    const end = Math.min(offset + size, file.size);
    const began = performance.now();
    const headers = { ...made.headers, "Content-Range": `bytes ${offset}-${end - 1}/${file.size}` };
    const body = file.slice(offset, end);
    try {
      await transport.request(made.url ?? "", { method: made.method ?? "PUT", headers, body, signal, signed: true, once: true });
      offset = end;
      if (performance.now() - began < PIECE_MS) size = Math.min(2 * size, PIECE_BYTES);
      patience.renew();
    } catch (failure) {
      // 403: the URL has expired. 409: the service has other bytes than we believed.
      const astray = failure instanceof MeshdeformError && (failure.status === 403 || failure.status === 409);
      if (!(failure instanceof MeshdeformError) || (!astray && !worthRetrying(failure))) throw failure;
      await patience.wait(failure, { signal });
      made = await current(transport, made.id, signal);
      if (made.state === "complete") return;
      if (made.offset > offset) patience.renew();
      offset = made.offset;
    }
    onProgress?.(offset);
  }
}

function current(transport: Transport, id: string, signal?: AbortSignal): Promise<Upload> {
  return transport.json<Upload>(`v1/uploads/${id}`, { signal });
}

/** Whether this place can compute the SHA-256 that an upload needs. */
export function canUpload(): boolean {
  return Boolean(globalThis.crypto?.subtle);
}

async function digest(file: Blob): Promise<string> {
  if (!canUpload()) {
    const detail = "An upload needs SHA-256, which browsers offer on https pages and on localhost only.";
    throw new MeshdeformError(0, { code: "checksum_unavailable", detail, advice: "Serve the page over https, or send the file with its job." });
  }
  const bytes = new Uint8Array(await crypto.subtle.digest("SHA-256", await file.arrayBuffer()));
  return [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}
