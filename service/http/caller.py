"""Who makes a request that makes something, and what of the request goes on the record."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

from fastapi import Request

from meshdeform.support.telemetry import current_traceparent
from service.http.auth import Principal
from service.http.middleware import request_id

__all__ = ["Caller"]

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
