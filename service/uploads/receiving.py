"""Receive the bytes of uploads, in pieces if need be, and complete uploads.

A job never uses an object that the sender can still write to. Bytes arrive under `uploads/ID/sent`. On completion they
are moved to `uploads/ID/sealed`, verified there, and copied to `assets/SHA256`. If the process dies after any of these
steps, completing the upload again continues.
"""

from __future__ import annotations

import re
import time
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime

from anyio import to_thread

from meshdeform.api.documents import UploadView
from meshdeform.errors import (
    AssetTooLargeError,
    ChecksumError,
    ConflictError,
    NotFoundError,
    RequestError,
    RequestTimeoutError,
    UnavailableError,
)
from meshdeform.record.reconciler import remove_upload
from meshdeform.record.uploads import Upload
from meshdeform.storage import sign_path, verify_path
from service.http.links import SIGNING_KEY
from service.state import AppState

# This many bytes are written, and count as received, before more of the body is read.
_BLOCK = 4 << 20
_RANGE = re.compile(r"bytes (\d{1,18})-(\d{1,18})/(\d{1,18})")


@dataclass(frozen=True)
class ContentRange:
    """Bytes [start, end) of an upload."""

    start: int
    end: int

    def exceeded(self) -> AssetTooLargeError:
        """Return the error for a body with more bytes."""
        size = self.end - self.start
        advice = "Send as many bytes as Content-Range or the upload's size announces."
        return AssetTooLargeError(f"The body is longer than {size} bytes.", advice=advice, limit=size)


def view(app: AppState, upload: Upload, *, offset: int | None = None) -> UploadView:
    """Return the public view of an upload, with a new signed URL while it is open; without its offset, look it up."""
    if offset is None:
        offset = upload.size if upload.complete else received_bytes(app, upload)
    common = UploadView(
        id=upload.id,
        filename=upload.filename,
        size=upload.size,
        state="complete" if upload.complete else "open",
        offset=offset,
        sha256=upload.sha256,
        created_at=upload.created_at,
        expires_at=upload.expires_at,
    )
    if upload.complete:
        return common
    # In whole seconds, and no later than the upload itself expires.
    until = min(int(time.time() + app.settings.signed_url_ttl_s), int(upload.expires_at.timestamp()))
    url, headers = _address(app, upload, until)
    return common.model_copy(
        update={
            "method": "PUT",
            "url": url,
            "url_expires_at": datetime.fromtimestamp(until, UTC),
            "headers": headers,
            "resumable": app.store.appends,
        }
    )


def _address(app: AppState, upload: Upload, until: int) -> tuple[str, dict[str, str]]:
    headers = {"Content-Type": "application/octet-stream"}
    if app.store.appends:
        path = f"/v1/uploads/{upload.id}/content"
        return f"{path}?{sign_path('PUT', path, until, app.record.secret(SIGNING_KEY))}", headers
    lifetime_s = min(max(1, until - int(time.time())), 7 * 86_400)
    url = app.store.presign_put(_sent_key(upload), lifetime_s)
    if url is None:
        raise UnavailableError(
            "This server's object store does not support uploads.", advice="Send the file with POST /v1/jobs."
        )
    if app.settings.resolved_storage_url.startswith(("az:", "azure:", "abfs")):
        headers["x-ms-blob-type"] = "BlockBlob"
    return url, headers


def received_bytes(app: AppState, upload: Upload) -> int:
    """Return the number of received bytes of an open upload."""
    with suppress(NotFoundError):
        return app.store.appended_size(upload.id) if app.store.appends else app.store.size(_sent_key(upload))
    return 0


def authorize(app: AppState, upload_id: str, path: str, query: str) -> Upload:
    """Verify a signed URL and return the upload that it grants write access to."""
    verify_path("PUT", path, query, app.record.secret(SIGNING_KEY))
    return app.record.uploads.get(upload_id)


def parse_content_range(header: str | None, upload: Upload) -> ContentRange:
    """Return the range of bytes that a request sends; the whole upload if there is no header.

    `RequestError`: the header is malformed or lies outside the upload.
    """
    if header is None:
        return ContentRange(0, upload.size)
    match = _RANGE.fullmatch(header.strip())
    first, last, total = (int(number) for number in match.groups()) if match else (0, -1, 0)
    if not first <= last < total == upload.size:
        raise RequestError(
            f"Content-Range must be `bytes FIRST-LAST/{upload.size}`, within the upload's size.",
            advice="Get the upload's offset with HEAD, and send the bytes from there on.",
        )
    return ContentRange(first, last + 1)


async def receive_content(app: AppState, upload: Upload, piece: ContentRange, body: AsyncIterator[bytes]) -> int:
    """Append a body to an upload as it arrives, and return the number of received bytes in total.

    Received bytes are kept even if the body is cut off. A body that covers the whole upload replaces earlier bytes.
    """
    if upload.complete:
        raise ConflictError(
            "The upload is complete.", advice="Create a new upload for other bytes.", offset=upload.size
        )
    present = await to_thread.run_sync(received_bytes, app, upload)
    if piece == ContentRange(0, upload.size) and present:
        await to_thread.run_sync(app.store.discard_append, upload.id)
    elif piece.start != present:
        raise ConflictError(
            f"The upload has {present} bytes; the request begins at {piece.start}.",
            advice="Send the bytes from the offset on.",
            offset=present,
        )
    offset, block = piece.start, bytearray()

    async def flush() -> None:
        nonlocal offset
        if block:
            offset = await to_thread.run_sync(app.store.append, upload.id, offset, [bytes(block)], upload.size)
            block.clear()

    try:
        async for chunk in body:
            if offset + len(block) + len(chunk) > piece.end:
                raise piece.exceeded()
            block += chunk
            if len(block) >= _BLOCK:
                await flush()
    except (RequestError, RequestTimeoutError):
        await flush()
        raise
    await flush()
    return offset


def complete(app: AppState, upload: Upload, sha256: str) -> Upload:
    """Turn an upload into a stored file that jobs can name. May be repeated, also after a crash at any point.

    `ChecksumError`: the received bytes differ from the announced ones; the upload stays open.
    """
    if upload.complete or (upload.sha256 is not None and upload.sha256 != sha256):
        return _check_completed(upload, sha256)
    try:
        _seal(app, upload, sha256)
        stored = app.store.measure(_sealed_key(upload))
        if (stored.size, stored.sha256) != (upload.size, sha256):
            # The sender wrote to it between the check and the move.
            app.store.delete(_sealed_key(upload))
            raise _mismatch(upload, sha256, stored.size, stored.sha256)
        key = f"assets/{sha256}"
        with app.record.files.leases() as leases:
            leases.take(key)
            if not app.store.holds(key, sha256):
                app.store.copy(_sealed_key(upload), key)
            done = app.record.uploads.complete(upload.id, sha256, key)
            leases.passed_on([key])
    except NotFoundError:
        # Another request completed it first, or it was deleted.
        return _check_completed(app.record.uploads.get(upload.id), sha256)
    with suppress(UnavailableError):
        # Remaining objects are removed with the upload.
        remove_upload(app.store, upload.id)
    return _check_completed(done, sha256)


def _seal(app: AppState, upload: Upload, sha256: str) -> None:
    """Move the bytes to a key that their sender cannot write to."""
    if not app.store.appends:
        try:
            size = app.store.size(_sent_key(upload))
        except NotFoundError:
            size = 0
        if size != upload.size:
            raise _mismatch(upload, sha256, size, None)
        app.store.copy(_sent_key(upload), _sealed_key(upload))
        return
    try:
        appended = app.store.appended(upload.id)
    except NotFoundError:
        if app.store.exists(_sealed_key(upload)):
            return
        raise _mismatch(upload, sha256, 0, None) from None
    if (appended.size, appended.sha256) != (upload.size, sha256):
        raise _mismatch(upload, sha256, appended.size, appended.sha256)
    app.store.commit_append(upload.id, _sealed_key(upload))


def _check_completed(upload: Upload, sha256: str) -> Upload:
    if not upload.complete or upload.sha256 != sha256:
        raise _mismatch(upload, sha256, upload.size if upload.complete else 0, upload.sha256)
    return upload


def _mismatch(upload: Upload, sha256: str, size: int, actual: str | None) -> ChecksumError:
    if size != upload.size:
        return ChecksumError(f"{size} of {upload.size} bytes have been received.", size=size, offset=size)
    return ChecksumError(f"The SHA-256 is {actual}, not {sha256}.", size=size, sha256=actual)


def _sent_key(upload: Upload) -> str:
    return f"uploads/{upload.id}/sent"


def _sealed_key(upload: Upload) -> str:
    return f"uploads/{upload.id}/sealed"
