"""Files that are sent by themselves: where their bytes go, how they come in pieces, and when they are complete.

What the sender can still write to is never what a job is made of. Bytes arrive in one place; when the sender says that
all are sent they are moved to another one, looked at there, and copied to `assets/SHA256` from there. Each step may be
the last one that is done: completing again goes on.
"""

from __future__ import annotations

import re
import time
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime

from anyio import to_thread

from meshdeform.errors import (
    AssetTooLargeError,
    ChecksumError,
    ConflictError,
    NotFoundError,
    RequestError,
    RequestTimeoutError,
    UnavailableError,
)
from meshdeform.record.cleanup import remove_upload
from meshdeform.record.uploads import Upload
from meshdeform.storage import sign_path, verify_path
from service.schemas import UploadView
from service.state import AppState

__all__ = ["ContentRange", "admitted", "arrived", "complete", "parse_content_range", "receive_content", "view"]

_KEY_NAME = "signed-urls"
# So many bytes are on the disk, and their arrival can be told, before more of the body is read.
_BLOCK = 4 << 20
_RANGE = re.compile(r"bytes (\d{1,18})-(\d{1,18})/(\d{1,18})")


@dataclass(frozen=True)
class ContentRange:
    """Bytes [start, end) of an upload."""

    start: int
    end: int


def view(app: AppState, upload: Upload, *, offset: int | None = None) -> UploadView:
    """Return what is told about an upload, with a new signed URL while it is open.

    Parameters
    ----------
    app : AppState
    upload : Upload
    offset : int, optional
        Bytes that have come; looked up unless given.
    """
    if offset is None:
        offset = upload.size if upload.complete else arrived(app, upload)
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
    # Not longer than the upload itself, and in whole seconds.
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
        return f"{path}?{sign_path('PUT', path, until, app.record.secret(_KEY_NAME))}", headers
    lifetime_s = min(max(1, until - int(time.time())), 7 * 86_400)
    url = app.store.presign_put(_sent(upload), lifetime_s)
    if url is None:
        raise UnavailableError(
            "This server's object store takes no uploads.", advice="Send the file with POST /v1/jobs."
        )
    if app.settings.resolved_storage_url.startswith(("az:", "azure:", "abfs")):
        headers["x-ms-blob-type"] = "BlockBlob"
    return url, headers


def arrived(app: AppState, upload: Upload) -> int:
    """Return how many bytes of an open upload have come."""
    with suppress(NotFoundError):
        return app.store.appended_size(upload.id) if app.store.appends else app.store.size(_sent(upload))
    return 0


def admitted(app: AppState, upload_id: str, path: str, query: str) -> Upload:
    """Return the upload that a signed URL lets its bearer write to.

    Raises
    ------
    ForbiddenError
        The URL is altered or over its time.
    NotFoundError
        There is no such upload any more.
    """
    verify_path("PUT", path, query, app.record.secret(_KEY_NAME))
    return app.record.uploads.get(upload_id)


def parse_content_range(header: str | None, upload: Upload) -> ContentRange:
    """Return which bytes a request brings; all of them where it does not say.

    Raises
    ------
    RequestError
        It cannot be.
    """
    if header is None:
        return ContentRange(0, upload.size)
    match = _RANGE.fullmatch(header.strip())
    first, last, total = (int(number) for number in match.groups()) if match else (0, -1, 0)
    if not first <= last < total == upload.size:
        raise RequestError(
            f"Content-Range must be `bytes FIRST-LAST/{upload.size}`, within the upload's size.",
            advice="Ask for the upload's offset with HEAD, and send the bytes from there on.",
        )
    return ContentRange(first, last + 1)


async def receive_content(app: AppState, upload: Upload, part: ContentRange, body: AsyncIterator[bytes]) -> int:
    """Add a body to an upload as it comes. What has come stays, also where the body breaks off.

    Parameters
    ----------
    app : AppState
    upload : Upload
    part : ContentRange
        Where the body belongs. The whole of it replaces what has come before.
    body : async iterator of bytes

    Returns
    -------
    int
        Bytes that have come altogether.

    Raises
    ------
    ConflictError
        The upload ends elsewhere (`offset`), is complete, or is written to by another request.
    AssetTooLargeError
        There is more than was announced.
    """
    if upload.complete:
        raise ConflictError("The upload is complete.", advice="Make a new one for other bytes.", offset=upload.size)
    present = await to_thread.run_sync(arrived, app, upload)
    if part == ContentRange(0, upload.size) and present:
        await to_thread.run_sync(app.store.discard_append, upload.id)
    elif part.start != present:
        raise ConflictError(
            f"The upload has {present} bytes; the request begins at {part.start}.",
            advice="Send the bytes from the offset on.",
            offset=present,
        )
    offset, block = part.start, bytearray()

    async def flush() -> None:
        nonlocal offset
        if block:
            offset = await to_thread.run_sync(app.store.append, upload.id, offset, [bytes(block)], upload.size)
            block.clear()

    try:
        async for chunk in body:
            if offset + len(block) + len(chunk) > part.end:
                raise AssetTooLargeError(
                    f"The body is longer than {part.end - part.start} bytes.",
                    advice="Send the bytes that Content-Range or the upload's size announces.",
                    limit=part.end - part.start,
                )
            block += chunk
            if len(block) >= _BLOCK:
                await flush()
    except (RequestError, RequestTimeoutError):
        await flush()
        raise
    await flush()
    return offset


def complete(app: AppState, upload: Upload, sha256: str) -> Upload:
    """Make an upload a stored file that jobs can name. May be repeated, also after a crash at any point.

    Raises
    ------
    ChecksumError
        The bytes that have come are not those that were announced; the upload stays open.
    """
    if upload.complete or (upload.sha256 is not None and upload.sha256 != sha256):
        return _agreed(upload, sha256)
    try:
        _seal(app, upload, sha256)
        found = app.store.measure(_sealed(upload))
        if (found.size, found.sha256) != (upload.size, sha256):
            # Written to between the look and the move.
            app.store.delete(_sealed(upload))
            raise _other(upload, sha256, found.size, found.sha256)
        key = f"assets/{sha256}"
        with app.record.files.leases() as leases:
            leases.take(key)
            if not app.store.exists(key):
                app.store.copy(_sealed(upload), key)
            done = app.record.uploads.complete(upload.id, sha256, key)
            leases.passed_on([key])
    except NotFoundError:
        # Another request was faster, or it was deleted.
        return _agreed(app.record.uploads.get(upload.id), sha256)
    with suppress(UnavailableError):
        # What is left goes with the upload.
        remove_upload(app.store, upload.id)
    return _agreed(done, sha256)


def _seal(app: AppState, upload: Upload, sha256: str) -> None:
    """Move the bytes to where their sender cannot write."""
    if not app.store.appends:
        try:
            size = app.store.size(_sent(upload))
        except NotFoundError:
            size = 0
        if size != upload.size:
            raise _other(upload, sha256, size, None)
        app.store.copy(_sent(upload), _sealed(upload))
        return
    try:
        found = app.store.appended(upload.id)
    except NotFoundError:
        if app.store.exists(_sealed(upload)):
            return
        raise _other(upload, sha256, 0, None) from None
    if (found.size, found.sha256) != (upload.size, sha256):
        raise _other(upload, sha256, found.size, found.sha256)
    app.store.commit_append(upload.id, _sealed(upload))


def _agreed(upload: Upload, sha256: str) -> Upload:
    if not upload.complete or upload.sha256 != sha256:
        raise _other(upload, sha256, upload.size if upload.complete else 0, upload.sha256)
    return upload


def _other(upload: Upload, sha256: str, size: int, found: str | None) -> ChecksumError:
    if size != upload.size:
        return ChecksumError(f"{size} bytes have come of {upload.size}.", size=size, offset=size)
    return ChecksumError(f"The SHA-256 is {found}, not {sha256}.", size=size, sha256=found)


def _sent(upload: Upload) -> str:
    return f"uploads/{upload.id}/sent"


def _sealed(upload: Upload) -> str:
    return f"uploads/{upload.id}/sealed"
