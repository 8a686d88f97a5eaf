/** Files that are sent ahead of their jobs, in pieces that can be resumed. */
import { MeshdeformError } from "./errors.js";
import { newKey, type Transport, worthRetrying } from "./transport.js";
import type { Upload } from "./types.js";

const PIECE_BYTES = 8 << 20;

export interface UploadOptions {
  filename?: string;
  signal?: AbortSignal;
  /** Called with the number of bytes that the service has, first with those that it has from before. */
  onProgress?: (bytes: number) => void;
  /** A file with the same key continues where it stopped, also in another process. */
  idempotencyKey?: string;
}

/** Upload a file completely; the service verifies its SHA-256. */
export async function upload(transport: Transport, file: Blob, filename: string, options: UploadOptions): Promise<Upload> {
  const { signal } = options;
  const sha256 = await digest(file);
  const headers = { "Idempotency-Key": options.idempotencyKey ?? newKey() };
  const json = { filename, size: file.size, sha256 };
  const response = await transport.request("v1/uploads", { method: "POST", json, headers, signal });
  let made = (await response.json()) as Upload;
  // The first answer again: bytes may have come since, and its URL may have expired.
  if (response.headers.has("Idempotency-Replayed")) made = await current(transport, made.id, signal);
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

async function pieces(transport: Transport, file: Blob, made: Upload, { signal, onProgress }: UploadOptions): Promise<void> {
  const patience = transport.patience();
  let offset = made.offset;
  onProgress?.(offset);
  while (offset < file.size) {
    const end = Math.min(offset + PIECE_BYTES, file.size);
    const headers = { ...made.headers, "Content-Range": `bytes ${offset}-${end - 1}/${file.size}` };
    const body = file.slice(offset, end);
    try {
      await transport.request(made.url ?? "", { method: made.method ?? "PUT", headers, body, signal, signed: true, once: true });
      offset = end;
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
