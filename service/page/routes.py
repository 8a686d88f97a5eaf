"""Serve the web page: `/`, its files below `/web/`, and `/llms.txt`. They need no API key; the page's requests do."""

from __future__ import annotations

import functools
import json
import os
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import Response
from starlette.routing import Route
from starlette.staticfiles import StaticFiles

from meshdeform.requests.document import DeformParams, OutputOptions

if TYPE_CHECKING:
    from starlette.types import Receive, Scope, Send

PAGE_HEADERS = {
    # Only this server's scripts and styles, data that the page holds itself (blob:, data:), and no other host.
    # WebAssembly is for mesh decoders; no text is ever run as a script.
    "Content-Security-Policy": "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self' blob: data:; worker-src 'self' blob:; font-src 'self'; "
    "manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "accelerometer=(), camera=(), display-capture=(), geolocation=(), gyroscope=(), "
    "magnetometer=(), microphone=(), payment=(), usb=()",
    # A page made of files from two releases would not work, so browsers revalidate every file.
    "Cache-Control": "no-cache",
}
"""Headers of every response that is part of the page."""

# `mimetypes` depends on the system's files, and browsers refuse scripts with the wrong type.
_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".glb": "model/gltf-binary",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".md": "text/markdown; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".wasm": "application/wasm",
    ".webmanifest": "application/manifest+json",
    ".webp": "image/webp",
    ".woff2": "font/woff2",
}


class _Page(StaticFiles):
    """Serves the files of `service/web` with the page's headers."""

    def get_path(self, scope: Scope) -> str:
        """Return the path of the requested file in the folder; for `/`, the page itself."""
        at_root = "llms.txt" if scope["path"].endswith("/llms.txt") else "index.html"
        path: str = scope["path_params"].get("path", at_root)
        return os.path.normpath(path.lstrip("/"))

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return a file, or raise 404 if the page is switched off."""
        if scope["app"].state.app_state.settings.web == "off":
            raise HTTPException(404)
        return await super().get_response(path, scope)

    def file_response(
        self, full_path: str | os.PathLike[str], stat_result: os.stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        """Return a file or 304. The tag is weak, because the compressed and the plain file share it."""
        response = super().file_response(full_path, stat_result, scope, status_code)
        tag = response.headers["etag"]
        response.headers.update({**PAGE_HEADERS, "ETag": f"W/{tag}"})
        if response.status_code == 200:
            response.headers["Content-Type"] = _TYPES.get(PurePath(full_path).suffix, "text/plain; charset=utf-8")
        return response


@functools.cache
def _parameters() -> bytes:
    """Return the schema of a job's parameters, from which the page builds its form, and the defaults of `output`."""
    schema = {**DeformParams.model_json_schema(), "x-output": OutputOptions().model_dump(mode="json")}
    return json.dumps(schema).encode()


async def _send_parameters(scope: Scope, receive: Receive, send: Send) -> None:
    if scope["app"].state.app_state.settings.web == "off":
        raise HTTPException(404)
    response = Response(_parameters(), headers=PAGE_HEADERS, media_type="application/json")
    await response(scope, receive, send)


_files = GZipMiddleware(_Page(directory=Path(__file__).parents[1] / "web", check_dir=False), compresslevel=6)
# Plain Starlette routes do not appear in the OpenAPI document.
routes = [
    Route("/web/parameters.json", GZipMiddleware(_send_parameters), methods=["GET"]),
    *(Route(path, _files, methods=["GET"]) for path in ("/", "/llms.txt", "/web/{path:path}")),
]
