/** Files that are sent ahead of their jobs, in pieces that can be resumed. */
import { MeshdeformError } from "./errors.js";
import { newKey, worthRetrying } from "./transport.js";
/** The first piece and the largest one; on a fast line each is twice the one before, so that progress is told on slow ones. */
const FIRST_PIECE_BYTES = 64 << 10;
const PIECE_BYTES = 8 << 20;
const PIECE_MS = 1000;
/** Upload a file completely; the service verifies its SHA-256. A file that it has from the last day is not sent again. */
export async function upload(transport, file, filename, options) {
    const { signal } = options;
    const sha256 = await digest(file);
    const made = await announced(transport, { filename, size: file.size, sha256 }, options);
    if (made.state === "complete")
        return made;
    if (!transport.directUploads && !transport.isOwn(made.url ?? "")) {
        const detail = "The service takes uploads at another host.";
        throw new MeshdeformError(0, { code: "upload_elsewhere", detail, advice: "Send the file with its job, or allow direct uploads." });
    }
    if (made.resumable)
        await pieces(transport, file, made, options);
    else {
        await transport.request(made.url ?? "", { method: made.method ?? "PUT", headers: made.headers ?? {}, body: file, signal, signed: true });
        options.onProgress?.(file.size);
    }
    return transport.json(`v1/uploads/${made.id}/complete`, { method: "POST", json: { sha256 }, signal });
}
/** The upload of a file as it is now: the one that was made for it before, or a new one. */
async function announced(transport, json, { signal, idempotencyKey }) {
    const key = idempotencyKey ?? `${json.sha256}/${encodeURIComponent(json.filename).slice(0, 150)}`;
    for (const name of [key, newKey()]) {
        const response = await transport.request("v1/uploads", { method: "POST", json, headers: { "Idempotency-Key": name }, signal });
        const made = (await response.json());
        if (!response.headers.has("Idempotency-Replayed"))
            return made;
        // The first answer again: bytes may have come since, its URL may have expired, or it was deleted.
        const now = await current(transport, made.id, signal).catch((failure) => {
            if (failure instanceof MeshdeformError && failure.status === 404)
                return null;
            throw failure;
        });
        if (now)
            return now;
    }
    throw new MeshdeformError(0, { code: "unavailable", detail: "The service has forgotten the upload." });
}
async function pieces(transport, file, made, { signal, onProgress }) {
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
            if (performance.now() - began < PIECE_MS)
                size = Math.min(2 * size, PIECE_BYTES);
            patience.renew();
        }
        catch (failure) {
            // 403: the URL has expired. 409: the service has other bytes than we believed.
            const astray = failure instanceof MeshdeformError && (failure.status === 403 || failure.status === 409);
            if (!(failure instanceof MeshdeformError) || (!astray && !worthRetrying(failure)))
                throw failure;
            await patience.wait(failure, { signal });
            made = await current(transport, made.id, signal);
            if (made.state === "complete")
                return;
            if (made.offset > offset)
                patience.renew();
            offset = made.offset;
        }
        onProgress?.(offset);
    }
}
function current(transport, id, signal) {
    return transport.json(`v1/uploads/${id}`, { signal });
}
/** Whether this place can compute the SHA-256 that an upload needs. */
export function canUpload() {
    return Boolean(globalThis.crypto?.subtle);
}
async function digest(file) {
    if (!canUpload()) {
        const detail = "An upload needs SHA-256, which browsers offer on https pages and on localhost only.";
        throw new MeshdeformError(0, { code: "checksum_unavailable", detail, advice: "Serve the page over https, or send the file with its job." });
    }
    const bytes = new Uint8Array(await crypto.subtle.digest("SHA-256", await file.arrayBuffer()));
    return [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}
