"""Send a file ahead of its jobs, in pieces, going on where it broke off."""

from __future__ import annotations

import hashlib

import httpx

from meshdeform.api.limits import MAX_FILENAME
from meshdeform.client.commands import Answer, Call, Operation, Pause, Piece, Send
from meshdeform.client.documents import UploadView, read
from meshdeform.client.problems import error_of, unreachable
from meshdeform.client.retries import NOT_WORTH_A_RETRY, Patience, Policy, answered, worth_a_retry
from meshdeform.client.sources import LocalFile
from meshdeform.errors import ConflictError, ForbiddenError, MeshdeformError

__all__ = ["uploaded"]

_PIECE = 8 * 2**20


def uploaded(file: LocalFile, key: str, policy: Policy) -> Operation[UploadView]:
    """Upload a file and return it complete, its SHA-256 compared by the service.

    Parameters
    ----------
    file : LocalFile
    key : str
        Names this upload: the same file with the same key goes on where it broke off, also in another process.
    policy : Policy

    Raises
    ------
    ChecksumError
        What came is not what was sent.
    MeshdeformError
        The service refuses.
    """
    asked = {"filename": file.filename[-MAX_FILENAME:], "size": file.size, "sha256": file.sha256}
    named = hashlib.sha256(f"{key}/{file.sha256}".encode()).hexdigest()
    answer = yield from answered(
        Call("POST", "/v1/uploads", headers={"Idempotency-Key": named}, document=asked), policy
    )
    upload = read(UploadView, answer.json(), answer.url)
    if "idempotency-replayed" in answer.headers:
        # As it was at first; meanwhile bytes may have come, and the URL may be over its time.
        upload = yield from _looked_at(upload.id, policy)
    if upload.state == "complete":
        return upload
    if upload.resumable:
        yield from _pieces(file, upload, policy)
    else:
        yield from _whole(file, upload, policy)
    done = yield from answered(
        Call("POST", f"/v1/uploads/{upload.id}/complete", document={"sha256": file.sha256}), policy
    )
    return read(UploadView, done.json(), done.url)


def _looked_at(upload_id: str, policy: Policy) -> Operation[UploadView]:
    answer = yield from answered(Call("GET", f"/v1/uploads/{upload_id}"), policy)
    return read(UploadView, answer.json(), answer.url)


def _whole(file: LocalFile, upload: UploadView, policy: Policy) -> Operation[None]:
    call = _put(upload, Piece(file.file, 0, file.size))
    yield from answered(call, policy)


def _pieces(file: LocalFile, upload: UploadView, policy: Policy) -> Operation[None]:
    patience = Patience(policy, retries=policy.max_retries, seconds=policy.timeout_s)
    offset = upload.offset
    while offset < file.size:
        piece = Piece(file.file, offset, min(_PIECE, file.size - offset))
        error: MeshdeformError
        try:
            answer: Answer = yield Send(_put(upload, piece, file.size))
        except httpx.HTTPError as failure:
            error = unreachable(failure, "/v1/uploads")
            if isinstance(failure, NOT_WORTH_A_RETRY):
                raise error from failure
        else:
            if answer.ok:
                offset = int(answer.headers.get("upload-offset", offset + piece.size))
                patience.renew()
                continue
            error = error_of(answer)
            # It stands elsewhere than we think; or the URL is over its time.
            astray = isinstance(error, ConflictError | ForbiddenError)
            if not astray and not worth_a_retry(error):
                raise error
        yield Pause(patience.pause(error))
        upload = yield from _looked_at(upload.id, policy)
        if upload.state == "complete":
            return
        if upload.offset > offset:
            patience.renew()
        offset = upload.offset


def _put(upload: UploadView, piece: Piece, size: int | None = None) -> Call:
    headers = dict(upload.headers)
    if size is not None:
        headers["Content-Range"] = f"bytes {piece.start}-{piece.start + piece.size - 1}/{size}"
    return Call(upload.method or "PUT", upload.url or "", headers=headers, piece=piece, signed=True)
