"""What surrounds every request: its id, the headers of every answer, the largest body, and its line in the log.

Plain ASGI, so that streams stay streams. It stands outside of everything else, also of what answers unknown errors.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import MutableMapping
from typing import TYPE_CHECKING, Any

from starlette.datastructures import Headers, MutableHeaders

from meshdeform.api.limits import MAX_DOCUMENT_BYTES
from meshdeform.errors import AssetTooLargeError
from meshdeform.record.ids import new_id
from meshdeform.support import logs

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["RequestFrame", "add_header", "request_id"]

_access = logging.getLogger(logs.ACCESS_LOG)
_ID = re.compile(r"[\x21-\x7e]{1,128}")
_HEADERS = "meshdeform.headers"
_DEFAULTS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    # An answer is data: should a browser show it as a page, it loads and runs nothing. Real pages set their own.
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
}


def request_id() -> str:
    """The id of the request that is being answered; empty where there is none."""
    return logs.request_id.get()


def add_header(scope: MutableMapping[str, Any], name: str, value: str) -> None:
    """Let the answer to a request carry a header, whatever makes the answer."""
    scope.setdefault(_HEADERS, {})[name] = value


class RequestFrame:
    """The outermost layer.

    Parameters
    ----------
    app : ASGI application
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        start = time.perf_counter()
        status = 500
        sent = Headers(scope=scope).get("x-request-id", "")
        identity = sent if _ID.fullmatch(sent) else new_id("req")
        # Never reset: the server runs each request in a task of its own, and logs what went wrong after this returned.
        logs.request_id.set(identity)
        scope.setdefault("state", {})["request_id"] = identity
        scope[_HEADERS] = {}

        async def framed(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                headers["X-Request-ID"] = identity
                for name, value in scope[_HEADERS].items():
                    headers[name] = value
                for name, value in _DEFAULTS.items():
                    headers.setdefault(name, value)
            await send(message)

        try:
            await self._app(scope, _limited(scope, receive), framed)
        finally:
            if _access.isEnabledFor(logging.INFO):
                _log_request(scope, status, 1000 * (time.perf_counter() - start))


def _limited(scope: Scope, receive: Receive) -> Receive:
    """Hold the bodies to a limit that FastAPI reads. A route without a body parameter reads its own, as it likes.

    Nothing is read before the route is known.
    """
    received = 0

    async def limited() -> Message:
        nonlocal received
        message = await receive()
        if message["type"] == "http.request":
            received += len(message.get("body", b""))
            if received > MAX_DOCUMENT_BYTES and getattr(scope.get("route"), "body_field", None) is not None:
                raise AssetTooLargeError(
                    f"The body is larger than {MAX_DOCUMENT_BYTES} bytes.",
                    advice="Send a smaller document: this route takes no files.",
                    limit=MAX_DOCUMENT_BYTES,
                )
        return message

    return limited


def _log_request(scope: Scope, status: int, duration_ms: float) -> None:
    # The route's template, not the path: lines of one route are alike, and no query string comes along, which may
    # hold a signature.
    route = getattr(scope.get("route"), "path", "-")
    fields = {"method": scope["method"], "route": route, "status": status, "duration_ms": round(duration_ms, 1)}
    _access.info("%s %s %d %.1f ms", *fields.values(), extra=fields)
