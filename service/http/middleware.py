"""Wrap every request: set its id and the response's standard headers, limit its body, log it, and trace it.

Plain ASGI, so that streaming works. `RequestFrame` is the outermost middleware, outside the handler of unexpected
errors.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import MutableMapping
from typing import TYPE_CHECKING, Any

import anyio
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse

from meshdeform.api.limits import IDLE_S, MAX_DOCUMENT_BYTES
from meshdeform.errors import AssetTooLargeError, RequestTimeoutError, readable_size
from meshdeform.record.ids import new_id
from meshdeform.support import telemetry
from meshdeform.support.telemetry import rename_span, span
from service.operations.metrics import route_of

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

_access = logging.getLogger(telemetry.ACCESS_LOG)
_ID = re.compile(r"[\x21-\x7e]{1,128}")
_HEADERS = "meshdeform.headers"
_DEFAULTS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    # Responses are data: a browser that shows one as a page may load and run nothing. Real pages set their own policy.
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
}
_QUIET = ("/healthz", "/readyz", "/metrics")


def request_id() -> str:
    """Return the id of the current request; empty outside of one."""
    return telemetry.request_id.get()


def add_header(scope: MutableMapping[str, Any], name: str, value: str) -> None:
    """Add a header to the response of a request, whichever handler creates the response."""
    scope.setdefault(_HEADERS, {})[name] = value


class RequestFrame:
    """The outermost middleware."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        start = time.perf_counter()
        status = 500
        request_id = Headers(scope=scope).get("x-request-id", "")
        identity = request_id if _ID.fullmatch(request_id) else new_id("req")
        # Never reset: each request runs in its own task, and the server logs its errors after this method returns.
        telemetry.request_id.set(identity)
        scope.setdefault("state", {})["request_id"] = identity
        scope[_HEADERS] = {}

        app = self._app if _has_one_host(scope) else _refuse_hosts

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
            await app(scope, _limited(scope, receive), framed)
        finally:
            if _access.isEnabledFor(logging.INFO):
                _log_request(scope, status, 1000 * (time.perf_counter() - start))


def _has_one_host(scope: Scope) -> bool:
    """Return whether a request says its host as RFC 9112, section 3.2 demands; HTTP/1.0 knows no Host header."""
    hosts = [value for name, value in scope["headers"] if name == b"host"]
    return len(hosts) == 1 or (not hosts and str(scope["http_version"]) != "1.1")


async def _refuse_hosts(scope: Scope, receive: Receive, send: Send) -> None:
    """Refuse a request without a Host header, or with several, of which a proxy may have read another one."""
    problem = {
        "type": "urn:meshdeform:problem:request_invalid",
        "title": "The request is not valid",
        "status": 400,
        "detail": "The request has several Host headers, or none.",
        "code": "request_invalid",
        "advice": "Send one.",
        "instance": scope["path"],
    }
    await JSONResponse(problem, 400, media_type="application/problem+json")(scope, receive, send)


def _limited(scope: Scope, receive: Receive) -> Receive:
    """Limit the size of bodies that FastAPI reads, and the time for them."""
    # A route without a body parameter reads and limits its body itself. FastAPI reads a body before it authenticates
    # the request.
    received, complete = 0, False
    deadline = anyio.current_time() + IDLE_S

    async def limited() -> Message:
        nonlocal received, complete
        if complete or getattr(scope.get("route"), "body_field", None) is None:
            return await receive()
        try:
            with anyio.fail_after(deadline - anyio.current_time()):
                message = await receive()
        except TimeoutError as error:
            raise RequestTimeoutError(f"The body did not arrive within {IDLE_S:g} s.") from error
        received += len(message.get("body", b""))
        complete = not message.get("more_body", False)
        if received > MAX_DOCUMENT_BYTES:
            raise AssetTooLargeError(
                f"The body is larger than {readable_size(MAX_DOCUMENT_BYTES)}.",
                advice="Send a smaller document; this route does not accept files.",
                limit=MAX_DOCUMENT_BYTES,
            )
        return message

    return limited


def _log_request(scope: Scope, status: int, duration_ms: float) -> None:
    # Log the route's template, not the path, so that lines can be grouped. The query may contain a signature.
    route = getattr(scope.get("route"), "path", "-")
    fields = {"method": scope["method"], "route": route, "status": status, "duration_ms": round(duration_ms, 1)}
    _access.info("%s %s %d %.1f ms", *fields.values(), extra=fields)


class TracingMiddleware:
    """Trace requests, except those of health checks and of Prometheus."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request within a span."""
        if scope["type"] != "http" or scope["path"] in _QUIET:
            await self._app(scope, receive, send)
            return
        caller = next((value.decode("latin-1") for name, value in scope["headers"] if name == b"traceparent"), None)
        method = scope["method"]
        with span(method, {"http.request.method": method}, traceparent=caller):
            try:
                await self._app(scope, receive, send)
            finally:
                # The route is known only after the router has run.
                route = route_of(scope)
                rename_span(f"{method} {route}", {"http.route": route})
