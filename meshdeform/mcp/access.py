"""Let only callers in whose API key the service accepts."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

from starlette.datastructures import Headers
from starlette.responses import JSONResponse

from meshdeform.client import AsyncClient
from meshdeform.errors import ForbiddenError, MeshdeformError, UnauthorizedError

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

__all__ = ["KeyCheck", "bearer"]

_REMEMBERED_S = 30.0
_MOST_REMEMBERED = 1000


def bearer(headers: Mapping[str, str]) -> str | None:
    """Return the token of an `Authorization: Bearer` header, or None."""
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() or None if scheme.lower() == "bearer" else None


class KeyCheck:
    """Answer 401 to callers without a key that the service accepts, before anything of their message is read.

    A key that was accepted is asked for again after 30 seconds; each call of a tool uses it at the service anyway.
    """

    def __init__(self, app: ASGIApp, url: str) -> None:
        self._app = app
        self._url = url
        self._accepted: dict[bytes, float] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it."""
        if scope["type"] == "http":
            refusal = await self._refusal(bearer(Headers(scope=scope)) or "")
            if refusal is not None:
                await refusal(scope, receive, send)
                return
        await self._app(scope, receive, send)

    async def _refusal(self, key: str) -> JSONResponse | None:
        name = hashlib.sha256(key.encode()).digest()
        if self._accepted.get(name, 0.0) > time.monotonic():
            return None
        try:
            async with AsyncClient(self._url, api_key=key, timeout_s=10.0, max_retries=0) as client:
                await client.limits()
        except (UnauthorizedError, ForbiddenError):
            detail = "Send an API key of the Meshdeform service as a bearer token."
            return JSONResponse({"detail": detail}, 401, {"WWW-Authenticate": 'Bearer realm="meshdeform"'})
        except (MeshdeformError, ValueError) as error:
            return JSONResponse({"detail": f"The Meshdeform service cannot be asked: {error}"}, 503)
        if len(self._accepted) >= _MOST_REMEMBERED:
            self._accepted.clear()
        self._accepted[name] = time.monotonic() + _REMEMBERED_S
        return None
