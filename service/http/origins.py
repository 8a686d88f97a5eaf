"""Let web pages of other origins use the API (CORS: fetch.spec.whatwg.org, section 3.3), and answer HEAD like GET.

Pages of listed origins may do what their key may. A signed URL is open to pages of any origin, as it is to anyone.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.middleware.cors import CORSMiddleware
from starlette.routing import Match, Router

from service.http.middleware import add_header

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

EXPOSED = (
    "Accept-Ranges",
    "Content-Disposition",
    "Content-Length",
    "Content-Range",
    "ETag",
    "Idempotency-Replayed",
    "Location",
    "Meshdeform-Asset",
    "Meshdeform-Draft",
    "Meshdeform-Warnings",
    "Preference-Applied",
    "RateLimit",
    "RateLimit-Policy",
    "Repr-Digest",
    "Retry-After",
    "Upload-Length",
    "Upload-Offset",
    "X-Request-ID",
)
"""The headers of answers that a page of another origin may read."""

_METHODS = ("DELETE", "GET", "HEAD", "PATCH", "POST", "PUT")
_REMEMBERED_S = 7200  # the longest that browsers remember a preflight
_SIGNED = (
    (re.compile(r"/v1/jobs/[^/]+/artifacts/[^/]+"), ("GET", "HEAD")),
    (re.compile(r"/v1/uploads/[^/]+/content"), ("PUT", "HEAD")),
)
"""Paths with the methods for which URLs are signed. A signature that is wrong is refused, whatever else was sent."""


class CrossOrigin:
    """Answer preflights, and say in answers which pages may read them."""

    def __init__(self, app: ASGIApp, application: FastAPI) -> None:
        self._app, self._application = app, application
        self._signed = [(path, methods, _allowing(app, ["*"], methods)) for path, methods in _SIGNED]
        self._listed: CORSMiddleware | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        app = self._app
        if scope["type"] == "http":
            app = self._for_signed(scope) or self._for_listed() or app
        await app(scope, receive, send)

    def _for_signed(self, scope: Scope) -> ASGIApp | None:
        if b"signature=" not in scope["query_string"] or "signature" not in parse_qs(scope["query_string"].decode()):
            return None
        wanted = Headers(scope=scope).get("access-control-request-method") if scope["method"] == "OPTIONS" else None
        method = wanted or scope["method"]
        for path, methods, app in self._signed:
            if method in methods and path.fullmatch(scope["path"]):
                add_header(scope, "Access-Control-Allow-Origin", "*")  # also for caches, which do not say for whom
                return app
        return None

    def _for_listed(self) -> ASGIApp | None:
        # The settings are read when the application starts, which is after it was built.
        origins = self._application.state.app_state.settings.cors_origins
        if origins and self._listed is None:
            self._listed = _allowing(self._app, origins, _METHODS)
        return self._listed


def _allowing(app: ASGIApp, origins: list[str], methods: tuple[str, ...]) -> CORSMiddleware:
    return CORSMiddleware(
        app,
        allow_origins=origins,
        allow_methods=methods,
        allow_headers=["*"],
        expose_headers=EXPOSED,
        max_age=_REMEMBERED_S,
    )


class HeadAsGet:
    """Answer HEAD where only GET is a route: with its status and headers (RFC 9110, section 9.3.2)."""

    def __init__(self, app: ASGIApp, router: Router) -> None:
        self._app, self._router = app, router

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http" or scope["method"] != "HEAD" or not self._only_get(scope):
            await self._app(scope, receive, send)
            return

        async def without_body(message: Message) -> None:
            if message["type"] == "http.response.body":
                message = {**message, "body": b""}
            await send(message)

        as_get = {**scope, "method": "GET"}
        try:
            await self._app(as_get, receive, without_body)
        finally:
            scope["route"] = as_get.get("route")  # for the log and the metrics

    def _only_get(self, scope: Scope) -> bool:
        """Return whether a path has a GET, and no HEAD. A stream of events does not count: it lasts as its job does."""
        return not scope["path"].endswith("/events") and not self._has(scope) and self._has({**scope, "method": "GET"})

    def _has(self, scope: Scope) -> bool:
        return any(route.matches(scope)[0] is Match.FULL for route in self._router.routes)
