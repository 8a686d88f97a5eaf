"""Execute requests with an `Idempotency-Key` once; a repeated request gets the first one's response."""

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

REPLAYED = "Idempotency-Replayed"

IdempotencyKey = Annotated[
    str | None,
    Header(
        description="An identifier of your choice, at most 255 visible ASCII characters. A request repeated with "
        "the same key within a day is executed once and gets the same response. Default: none.",
        max_length=MAX_KEY,
        pattern=r"^[\x21-\x7e]+$",
        examples=["0b9f2c6e-shot-sc010-take-3"],
    ),
]
_TRACEPARENT = re.compile(r"[0-9a-f]{2}-[0-9a-f]{32}-[0-9a-f]{16}-[0-9a-f]{2}")


@dataclass(frozen=True)
class KeptAnswer:
    """The JSON response to a request, and whether it was sent before."""

    status: int
    body: dict[str, Any]
    headers: dict[str, str] = field(default_factory=dict)
    replayed: bool = False

    def kept(self) -> dict[str, Any]:
        """Return the members that are stored in the record."""
        return {"status": self.status, "body": self.body, "headers": self.headers}

    def response(self) -> JSONResponse:
        """Return the HTTP response."""
        marked = {REPLAYED: "true"} if self.replayed else {}
        return JSONResponse(self.body, self.status, {**self.headers, **marked})


def request_hash(method: str, path: str, document: Any, files: Mapping[str, str]) -> str:
    """Return the SHA-256 of a request, including the SHA-256 of each of its files."""
    whole = {"method": method, "path": path, "document": document, "files": dict(files)}
    text = json.dumps(whole, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


@contextmanager
def claimed(record: JobRecord, caller: Caller, hashed: str) -> Iterator[Claim | KeptAnswer | None]:
    """Hold the request's idempotency key while the block executes the request.

    It yields the claim, to complete in the transaction that executes the request; the answer, if it was executed
    before; None if the request has no key.
    """
    if caller.idempotency_key is None:
        yield None
        return
    claim = record.idempotency.begin(caller.owner_id, caller.idempotency_key, hashed)
    if isinstance(claim, dict):
        yield KeptAnswer(**claim, replayed=True)
        return
    try:
        yield claim
    except BaseException:
        # Release the key for another try. If the record is unavailable, the claim expires.
        with suppress(UnavailableError):
            record.idempotency.abandon(claim)
        raise


@dataclass(frozen=True)
class Caller:
    """The caller and the headers of a request."""

    principal: Principal
    method: str
    path: str
    idempotency_key: str | None = None
    request_id: str | None = None
    traceparent: str | None = None

    @property
    def owner_id(self) -> str:
        """Owner of everything that the caller sees and creates."""
        return self.principal.owner_id

    @classmethod
    def of(cls, request: Request, principal: Principal, idempotency_key: str | None = None) -> Self:
        """Return the caller of a request."""
        trace = request.headers.get("traceparent", "")
        return cls(
            principal=principal,
            method=request.method,
            path=request.url.path,
            idempotency_key=idempotency_key,
            request_id=request_id() or None,
            # If tracing is off, pass the caller's trace on to the job unchanged.
            traceparent=current_traceparent() or (trace if _TRACEPARENT.fullmatch(trace) else None),
        )
