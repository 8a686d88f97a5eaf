"""Requests with an `Idempotency-Key` are done once; the same request again gets the answer that the first one got."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Annotated, Any, Self

from fastapi import Header, Request
from fastapi.responses import JSONResponse

from meshdeform.api.limits import MAX_KEY
from meshdeform.errors import UnavailableError
from meshdeform.record.models import Claim
from meshdeform.record.repository import JobRecord
from meshdeform.support.telemetry import current_traceparent
from service.http.auth import Principal
from service.http.middleware import request_id

__all__ = ["REPLAYED", "Answer", "Caller", "IdempotencyKey", "claimed", "request_hash"]

REPLAYED = "Idempotency-Replayed"

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

    def kept(self) -> dict[str, Any]:
        """Return what the record keeps of it."""
        return {"status": self.status, "body": self.body, "headers": self.headers}

    def response(self) -> JSONResponse:
        """As the client gets it."""
        marked = {REPLAYED: "true"} if self.replayed else {}
        return JSONResponse(self.body, self.status, {**self.headers, **marked})


def request_hash(method: str, path: str, document: Any, files: Mapping[str, str]) -> str:
    """SHA-256 of a request: what it asks for, and the SHA-256 of each file that comes with it."""
    whole = {"method": method, "path": path, "document": document, "files": dict(files)}
    text = json.dumps(whole, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


@contextmanager
def claimed(record: JobRecord, caller: Caller, hashed: str) -> Iterator[Claim | Answer | None]:
    """Hold the request's idempotency key while the block does what the request asks for.

    Parameters
    ----------
    record : JobRecord
    caller : Caller
        With the key, if the request has one.
    hashed : str
        Of the request.

    Yields
    ------
    Claim, Answer or None
        The claim, to be completed in the transaction that does it; the answer, where it was done before; None where the
        request has no key.

    Raises
    ------
    IdempotencyMismatchError, IdempotencyBusyError
        The key belongs to another request, or to one that is under way.
    """
    if caller.idempotency_key is None:
        yield None
        return
    claim = record.idempotency.begin(caller.owner_id, caller.idempotency_key, hashed)
    if isinstance(claim, dict):
        yield Answer(**claim, replayed=True)
        return
    try:
        yield claim
    except BaseException:
        # Refused: the key is free for another try. Where the record is away, it becomes so by itself.
        with suppress(UnavailableError):
            record.idempotency.abandon(claim)
        raise


_TRACEPARENT = re.compile(r"[0-9a-f]{2}-[0-9a-f]{32}-[0-9a-f]{16}-[0-9a-f]{2}")


@dataclass(frozen=True)
class Caller:
    """The side of a request that is not its body.

    Attributes
    ----------
    principal : Principal
    method, path : str
    idempotency_key : str or None
    request_id, traceparent : str or None
        For logs and traces.
    """

    principal: Principal
    method: str
    path: str
    idempotency_key: str | None = None
    request_id: str | None = None
    traceparent: str | None = None

    @property
    def owner_id(self) -> str:
        """Whose things they see and make."""
        return self.principal.owner_id

    @classmethod
    def of(cls, request: Request, principal: Principal, idempotency_key: str | None = None) -> Self:
        """Return who makes a request."""
        trace = request.headers.get("traceparent", "")
        return cls(
            principal=principal,
            method=request.method,
            path=request.url.path,
            idempotency_key=idempotency_key,
            request_id=request_id() or None,
            # Without tracing of our own the job carries the caller's trace on as it came.
            traceparent=current_traceparent() or (trace if _TRACEPARENT.fullmatch(trace) else None),
        )
