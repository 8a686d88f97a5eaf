"""Trace requests with spans, as children of the caller's span if `traceparent` gives one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from meshdeform.support.telemetry import rename_span, span
from service.operations.metrics import route_of

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

__all__ = ["TracingMiddleware"]

_QUIET = ("/healthz", "/readyz", "/metrics")


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
