"""Upload a file for jobs, in pieces that can be resumed."""

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
    """Upload a file completely, with its SHA-256 verified by the service, and return the upload.

    Parameters
    ----------
    file : LocalFile
    key : str
        Identifies this upload: the same file with the same key resumes where it stopped, also in another process.
    policy : Policy

    Raises
    ------
    ChecksumError
        The received bytes differ from the file.
    MeshdeformError
        The service refused the upload.
    """
    asked = {"filename": file.filename[-MAX_FILENAME:], "size": file.size, "sha256": file.sha256}
    named = hashlib.sha256(f"{key}/{file.sha256}".encode()).hexdigest()
    answer = yield from answered(
        Call("POST", "/v1/uploads", headers={"Idempotency-Key": named}, document=asked), policy
    )
    upload = read(UploadView, answer.json(), answer.url)
    if "idempotency-replayed" in answer.headers:
        # This is the upload's first state: bytes may have arrived since, and its URL may have expired.
        upload = yield from _current_state(upload.id, policy)
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


def _current_state(upload_id: str, policy: Policy) -> Operation[UploadView]:
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
            # The offset is not the one expected, or the URL has expired.
            astray = isinstance(error, ConflictError | ForbiddenError)
            if not astray and not worth_a_retry(error):
                raise error
        yield Pause(patience.pause(error))
        upload = yield from _current_state(upload.id, policy)
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
