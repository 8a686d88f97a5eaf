"""Serve the web page: `/`, its files below `/web/`, and `/llms.txt`. They need no API key; the page's requests do.

`/` names its files below the page's edition, `/web/~0123456789abcdef/`, so browsers keep them for good and ask for none
of them when the page is opened again.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import re
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import Response
from starlette.routing import Route
from starlette.staticfiles import StaticFiles

from meshdeform.requests.document import DeformParams, GuidanceKind, OutputParams
from meshdeform.requests.parameters import OF_OPTIMISER

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
    # A page made of files from two releases would not work, so browsers revalidate what has no edition in its path.
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
    ".ndf": "application/octet-stream",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".wasm": "application/wasm",
    ".webmanifest": "application/manifest+json",
    ".webp": "image/webp",
    ".woff2": "font/woff2",
    ".zip": "application/zip",
}


_WEB = Path(__file__).parents[1] / "web"
_EDITION = re.compile(r"^~[0-9a-f]{16}/")
_KEPT = {"Cache-Control": "public, max-age=31536000, immutable"}
_UNUSED_BY_EXEMPLARS = OF_OPTIMISER | {"preset"}  # which is allowed there, and changes nothing


class _Page(StaticFiles):
    """Serves the files of `service/web` with the page's headers."""

    edition = ""

    def get_path(self, scope: Scope) -> str:
        """Return the path of the requested file in the folder; for `/`, the page itself."""
        at_root = "llms.txt" if scope["path"].endswith("/llms.txt") else "index.html"
        path: str = scope["path_params"].get("path", at_root)
        return os.path.normpath(_EDITION.sub("", path).lstrip("/"))

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return a file, or raise 404 if the page is switched off."""
        if scope["app"].state.app_state.settings.web == "off":
            raise HTTPException(404)
        if path == "index.html" and not scope["path_params"]:
            self.edition = _edition()
            tag = f'"{self.edition}"'
            headers = {**PAGE_HEADERS, "ETag": f"W/{tag}"}
            if self.is_not_modified(Headers({"etag": tag}), Headers(scope=scope)):
                return Response(status_code=304, headers=headers)
            page = (_WEB / path).read_text(encoding="utf-8").replace('="web/', f'="web/{self.edition}/')
            return Response(page, headers=headers, media_type="text/html")
        return await super().get_response(path, scope)

    def file_response(
        self, full_path: str | os.PathLike[str], stat_result: os.stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        """Return a file or 304. The tag is weak, because the compressed and the plain file share it."""
        response = super().file_response(full_path, stat_result, scope, status_code)
        tag = response.headers["etag"]
        response.headers.update({**PAGE_HEADERS, "ETag": f"W/{tag}"})
        self.edition = self.edition or _edition()
        if scope["path_params"].get("path", "").startswith(f"{self.edition}/"):
            response.headers.update(_KEPT)
        if response.status_code == 200:
            response.headers["Content-Type"] = _TYPES.get(PurePath(full_path).suffix, "text/plain; charset=utf-8")
        return response


def _edition() -> str:
    """Return a name of the page's files as they are now, which changes with any of them."""
    files = sorted(path for path in _WEB.rglob("*") if path.is_file())
    facts = [(str(path.relative_to(_WEB)), (stat := path.stat()).st_size, stat.st_mtime_ns) for path in files]
    return f"~{hashlib.sha256(repr(facts).encode()).hexdigest()[:16]}"


@functools.cache
def _parameters() -> bytes:
    """Return the schema of a job's parameters, from which the page builds its form, and what a schema cannot say.

    `x-output`: the defaults of `output`; `x-unused`: the parameters that a kind of guidance does without.
    """
    schema = {
        **DeformParams.model_json_schema(),
        "x-output": OutputParams().model_dump(mode="json"),
        "x-unused": {GuidanceKind.EXEMPLAR: sorted(_UNUSED_BY_EXEMPLARS)},
    }
    return json.dumps(schema).encode()


async def _send_parameters(scope: Scope, receive: Receive, send: Send) -> None:
    if scope["app"].state.app_state.settings.web == "off":
        raise HTTPException(404)
    response = Response(_parameters(), headers=PAGE_HEADERS, media_type="application/json")
    await response(scope, receive, send)


_files = GZipMiddleware(_Page(directory=_WEB, check_dir=False), compresslevel=6)
# Plain Starlette routes do not appear in the OpenAPI document.
routes = [
    Route("/web/parameters.json", GZipMiddleware(_send_parameters), methods=["GET"]),
    *(Route(path, _files, methods=["GET"]) for path in ("/", "/llms.txt", "/web/{path:path}")),
]
