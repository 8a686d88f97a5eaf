"""Requests with an `Idempotency-Key` are done once; the same request again gets the answer that the first one got."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import sqlalchemy as sa
from fastapi import Header
from fastapi.responses import JSONResponse

from meshdeform.errors import UnavailableError
from meshdeform.record.repository import JobRecord
from service.http.caller import Caller

__all__ = ["MAX_KEY", "REPLAYED", "Answer", "IdempotencyKey", "Keep", "done_once", "request_hash"]

REPLAYED = "Idempotency-Replayed"
MAX_KEY = 255

IdempotencyKey = Annotated[
    str | None,
    Header(
        description="A name of this request of your own, at most 255 visible ASCII characters: the same request with "
        "the same key within a day is done once, and gets the same answer. Default: none.",
        max_length=MAX_KEY,
        pattern=r"^[\x21-\x7e]+$",
        examples=["0b9f2c6e-shot-sc010-take-3"],
    ),
]


@dataclass(frozen=True)
class Answer:
    """What a request is answered with.

    Attributes
    ----------
    status : int
    body : dict
        JSON.
    headers : dict
    replayed : bool
        Whether it was given before.
    """

    status: int
    body: dict[str, Any]
    headers: dict[str, str] = field(default_factory=dict)
    replayed: bool = False

    def response(self) -> JSONResponse:
        """As the client gets it."""
        marked = {REPLAYED: "true"} if self.replayed else {}
        return JSONResponse(self.body, self.status, {**self.headers, **marked})


def _keep_nothing(connection: sa.Connection, answer: Answer) -> None:
    """A request without a key."""
    del connection, answer


Keep = Callable[[sa.Connection, Answer], None]
"""Writes the answer in the transaction that does what the request asks for."""


def request_hash(method: str, path: str, document: Any, files: Mapping[str, str]) -> str:
    """SHA-256 of a request: what it asks for, and the SHA-256 of each file that comes with it."""
    whole = {"method": method, "path": path, "document": document, "files": dict(files)}
    text = json.dumps(whole, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def done_once(record: JobRecord, caller: Caller, hashed: str, work: Callable[[Keep], Answer]) -> Answer:
    """Do what a request asks for, unless it was done before.

    Parameters
    ----------
    record : JobRecord
    caller : Caller
        With the key, if the request has one.
    hashed : str
        Of the request.
    work : callable
        Does it. What it gets must be called within the transaction that does it.

    Raises
    ------
    IdempotencyMismatchError, IdempotencyBusyError
        The key belongs to another request, or to one that is under way.
    """
    key = caller.idempotency_key
    if key is None:
        return work(_keep_nothing)
    claim = record.idempotency.begin(caller.owner_id, key, hashed)
    if isinstance(claim, dict):
        return replace(Answer(**claim), replayed=True)

    def keep(connection: sa.Connection, answer: Answer) -> None:
        told = {"status": answer.status, "body": answer.body, "headers": answer.headers}
        record.idempotency.complete(claim, told, connection)

    try:
        return work(keep)
    except BaseException:
        # Refused: the key is free for another try. Where the record is away, it becomes so by itself.
        with suppress(UnavailableError):
            record.idempotency.abandon(claim)
        raise
