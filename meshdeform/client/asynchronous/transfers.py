"""Move a job's files and events: uploads and downloads that resume, and streams of events that reconnect."""

from __future__ import annotations

import contextlib
import hashlib
import time
import uuid
from collections.abc import AsyncGenerator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import httpx

from meshdeform.api.documents import UploadView
from meshdeform.api.jobs import EventView
from meshdeform.api.limits import MAX_FILENAME
from meshdeform.client.asynchronous.connection import AsyncConnection, pause, tell, work
from meshdeform.client.documents import PartialFile, read, to_disk
from meshdeform.client.events import EventOrder, EventStream, events_call
from meshdeform.client.orders import AssetLike, Files, LocalFile, Order, UploadProgress, open_source, refer
from meshdeform.client.problems import error_of
from meshdeform.client.requests import Call, FileRange, FormFile, job_path
from meshdeform.client.retries import Patience, left_s, unanswered, worth_a_retry
from meshdeform.errors import (
    ConflictError,
    ForbiddenError,
    MeshdeformError,
    NotFoundError,
    RangeError,
    UnavailableError,
)

_LIVED_S = 5.0  # a connection that lasted this long does not count as a failure
_STALE = 0.75
_WORD_S = 660.0
_PIECE_S = 1.0  # the next piece is larger if one took less, so that progress is told on slow lines too


async def prepared(
    connection: AsyncConnection, url: str, order: Order, files: Files, opened: contextlib.ExitStack
) -> tuple[Call, dict[str, LocalFile]]:
    """Return the request that posts an order, and its local files, after uploading those that are large."""
    document = order.document()
    local_files: dict[str, LocalFile] = {}
    form_files: list[FormFile] = []
    for name, file in files.by_field.items():
        filename = files.filename if name == "asset" or len(files.by_field) == 1 else None
        source = await work(open_source, file, opened, filename)
        if not isinstance(source, LocalFile):
            refer(document, name, source)
            continue
        local_files[name] = source
        large = source.size > connection.policy.upload_above if files.upload is None else files.upload
        try:
            upload = await uploaded(connection, source) if large and source.size else None
        except NotFoundError:
            if files.upload:
                raise
            upload = None  # the service has no uploads
        if upload is None:
            form_files.append(FormFile(name, source.filename, source.file))
        else:
            refer(document, name, {"upload_id": upload.id})
    headers = {"Idempotency-Key": files.key} if url == "/v1/jobs" else {}
    return Call("POST", url, headers=headers, document=document, files=tuple(form_files)), local_files


async def prepared_word(
    connection: AsyncConnection,
    said: dict[str, Any],
    meshes: Sequence[AssetLike],
    key: str,
    opened: contextlib.ExitStack,
) -> Call:
    """Return the request that makes a word, after uploading the meshes that make its form large."""
    form_files, stored, size = list[FormFile](), list[Mapping[str, str]](), 0
    for mesh in meshes:
        source = await work(open_source, mesh, opened)
        if not isinstance(source, LocalFile):
            stored.append(source)
        elif size + source.size > connection.policy.upload_above:
            stored.append({"upload_id": (await uploaded(connection, source)).id})
        else:
            form_files.append(FormFile("meshes", source.filename, source.file))
            size += source.size
    headers, document = {"Idempotency-Key": key}, {**said, "meshes": stored}
    return Call(
        "POST", "/v1/words", headers=headers, document=document, files=tuple(form_files), read_timeout_s=_WORD_S
    )


# Uploads


async def uploaded(connection: AsyncConnection, file: LocalFile, key: str = "") -> UploadView:
    """Upload a file completely, with its SHA-256 verified by the service, and return the upload.

    The same file with the same key is sent once within a day, and resumes where it stopped, also in another process.
    """
    upload = await _announced(connection, file, key)
    if upload.state == "complete":
        return upload
    if upload.resumable:
        await _send_pieces(connection, file, upload)
    else:
        await connection.answered(_put(upload, FileRange(file.file, 0, file.size)))
        await _told(connection, file, file.size)
    completion = Call("POST", f"/v1/uploads/{upload.id}/complete", document={"sha256": file.sha256})
    return await connection.document(UploadView, completion)


async def _announced(connection: AsyncConnection, file: LocalFile, key: str) -> UploadView:
    """Return the upload of a file as it is now: the one that was made for it before, or a new one."""
    about = {"filename": file.filename[-MAX_FILENAME:], "size": file.size, "sha256": file.sha256}
    name = f"{key}/{about['filename']}/{file.sha256}"
    for again in ("", f"/{uuid.uuid4().hex}"):
        headers = {"Idempotency-Key": hashlib.sha256(f"{name}{again}".encode()).hexdigest()}
        answer = await connection.answered(Call("POST", "/v1/uploads", headers=headers, document=about))
        upload = read(UploadView, answer.json(), answer.url)
        if "idempotency-replayed" not in answer.headers:
            break
        # This is the upload's first state: bytes may have arrived since, its URL may have expired, or it was deleted.
        with contextlib.suppress(NotFoundError):
            return await connection.document(UploadView, Call("GET", f"/v1/uploads/{upload.id}"))
    return upload


async def _told(connection: AsyncConnection, file: LocalFile, sent: int) -> None:
    if connection.on_upload is not None:
        await tell(connection.on_upload, UploadProgress(file.filename, sent, file.size))


async def _send_pieces(connection: AsyncConnection, file: LocalFile, upload: UploadView) -> None:
    policy = connection.policy
    patience = Patience(policy, retries=policy.max_retries, seconds=policy.timeout_s)
    offset, size = upload.offset, min(policy.first_piece_bytes, policy.piece_bytes)
    while offset < file.size:
        await _told(connection, file, offset)
        piece, began = FileRange(file.file, offset, min(size, file.size - offset)), time.monotonic()
        error: MeshdeformError
        try:
            answer = await connection.send(_put(upload, piece, file.size))
        except httpx.HTTPError as failure:
            error = unanswered(failure, "/v1/uploads")
        else:
            if answer.ok:
                offset = int(answer.headers.get("upload-offset", offset + piece.size))
                patience.renew()
                if time.monotonic() - began < _PIECE_S:
                    size = min(2 * size, policy.piece_bytes)
                continue
            error = error_of(answer)
            # The offset is not the one expected, or the URL has expired.
            astray = isinstance(error, ConflictError | ForbiddenError)
            if not astray and not worth_a_retry(error):
                raise error
        await pause(patience.pause(error))
        upload = await connection.document(UploadView, Call("GET", f"/v1/uploads/{upload.id}"))
        if upload.state == "complete":
            break
        if upload.offset > offset:
            patience.renew()
        offset = upload.offset
    await _told(connection, file, file.size)


def _put(upload: UploadView, piece: FileRange, size: int | None = None) -> Call:
    headers = dict(upload.headers)
    if size is not None:
        headers["Content-Range"] = f"bytes {piece.start}-{piece.start + piece.size - 1}/{size}"
    return Call(upload.method or "PUT", upload.url or "", headers=headers, piece=piece, signed=True)


# Downloads


async def loaded(connection: AsyncConnection, url: str) -> bytes:
    """Download a file and return its bytes."""
    file = BytesIO()
    await _receive(connection, url, file, None)
    return file.getvalue()


async def saved(connection: AsyncConnection, url: str, path: Path, sha256: str | None = None) -> Path:
    """Download a file to a path, replacing what is there, once it is complete.

    Its bytes must have the SHA-256 that the service sends, and the one that is expected.
    """
    aside = path.with_name(f".{path.name[:100]}.{uuid.uuid4().hex}.part")
    file: IO[bytes] = await work(aside.open, "xb")
    try:
        with file:
            await _receive(connection, url, file, sha256)
            await work(to_disk, file)
        await work(aside.replace, path)
    finally:
        aside.unlink(missing_ok=True)
    return path


async def _receive(connection: AsyncConnection, url: str, file: IO[bytes], sha256: str | None) -> None:
    policy = connection.policy
    patience = Patience(policy, retries=policy.max_retries, seconds=policy.timeout_s)
    received = PartialFile(file)
    while True:
        error: MeshdeformError
        try:
            await _receive_rest(connection, url, received, patience)
            break
        except httpx.HTTPError as failure:
            error = unanswered(failure, url)
        except MeshdeformError as refused:
            error = refused
            if isinstance(refused, RangeError):
                received.tag = ""
            elif not worth_a_retry(refused):
                raise
        await work(received.flush)
        if not received.tag:
            await work(received.begin)
        await pause(patience.pause(error))
    received.verify(sha256)


async def _receive_rest(connection: AsyncConnection, url: str, received: PartialFile, patience: Patience) -> None:
    """Receive the bytes of a file after those that have arrived, over one connection."""
    headers = {"Accept-Encoding": "identity", **received.headers()}
    async with connection.stream(Call("GET", url, headers=headers)) as (answer, body):
        if not answer.ok:
            raise error_of(answer)
        if answer.status != httpx.codes.PARTIAL_CONTENT:
            await work(received.begin)
        received.tag = answer.headers.get("etag", "")
        async for data in body:
            if received.tag:
                patience.renew()  # a retry resumes after the received bytes
            if received.add(data):
                await work(received.flush)
        await work(received.flush)


# Events


async def followed(
    connection: AsyncConnection, job_id: str, after: int, deadline: float | None = None
) -> AsyncGenerator[EventView]:
    """Yield a job's events after a number, each once and in order, up to the one that ends the job.

    The deadline is in the time of the monotonic clock.
    """
    policy = connection.policy
    patience = Patience(policy, retries=None if policy.max_retries else 0, seconds=policy.reconnect_s)
    order = EventOrder(after)
    while True:
        silence_s = min(policy.silence_s, left_s(deadline, job_id))
        error: MeshdeformError
        try:
            async with connection.stream(events_call(job_id, order.after, silence_s)) as (answer, body):
                if answer.status == 204:
                    return
                events = EventStream(job_id, answer)
                patience.alive()
                async for data in body:
                    if events.age_s > _LIVED_S:
                        patience.renew()
                    for event in order.accepted(events.feed(data)):
                        patience.renew()
                        yield event
                        if event.type.terminal:
                            return
                    # The connection's read timeout, which httpx fixes, may by now be much longer than the time left.
                    stale = deadline is not None and deadline - time.monotonic() < _STALE * silence_s
                    if order.missing or stale:
                        break
                else:
                    raise UnavailableError(f"The stream of events of {job_id} ended before the job did.")
            continue
        except httpx.HTTPError as failure:
            left_s(deadline, job_id)
            error = unanswered(failure, job_path(job_id, "events"))
        except MeshdeformError as refused:
            if not worth_a_retry(refused):
                raise
            error = refused
        pause_s = patience.pause(error)
        await pause(pause_s if deadline is None else max(min(pause_s, deadline - time.monotonic()), 0.0))
