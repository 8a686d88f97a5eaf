"""The files of the web page: found in the package, told apart by tag, compressed once.

Only what lies in `service/web` is ever opened: a path is taken apart first, and what it leads to must lie inside.
"""

from __future__ import annotations

import gzip
import hashlib
import re
import threading
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path, PurePosixPath

__all__ = ["PAGE_HEADERS", "PageFile", "PageFiles", "page_file"]

PAGE_HEADERS = {
    # Its own scripts and styles, bytes that it holds itself (blob:, data:), and no other host at all. WebAssembly is
    # for decoders of meshes; no text is ever run as a script.
    "Content-Security-Policy": "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self' blob: data:; worker-src 'self' blob:; font-src 'self'; "
    "manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "accelerometer=(), camera=(), display-capture=(), geolocation=(), gyroscope=(), "
    "magnetometer=(), microphone=(), payment=(), usb=()",
}
"""Headers of every answer that is part of the page."""

# Not `mimetypes`: it reads files of the system, which differ from machine to machine.
_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".glb": "model/gltf-binary",
    ".html": "text/html; charset=utf-8",
    ".ico": "image/x-icon",
    ".jpg": "image/jpeg",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".map": "application/json",
    ".md": "text/markdown; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".wasm": "application/wasm",
    ".webmanifest": "application/manifest+json",
    ".woff2": "font/woff2",
}
_DENSE = {"font/woff2", "image/jpeg", "image/png"}  # compressed by themselves
_TEXT = _TYPES[".txt"]
_LICENCE = "LICENSE"
_LEAST_COMPRESSED = 512
_PART = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
_MOST_PARTS = 10


@dataclass(frozen=True)
class PageFile:
    """A file of the page.

    Attributes
    ----------
    content : bytes
    compressed : bytes or None
        By gzip; None where that gains nothing.
    content_type : str
    digest : str
        SHA-256 of the content, hexadecimal.
    """

    content: bytes
    compressed: bytes | None
    content_type: str
    digest: str


class PageFiles:
    """The files below one folder. Safe to share between threads.

    Parameters
    ----------
    root : Traversable, optional
        The package's own unless given; it need not exist.
    """

    def __init__(self, root: Traversable | None = None) -> None:
        self._root = files("service") / "web" if root is None else root
        self._known: dict[str, tuple[tuple[int, int], PageFile]] = {}
        self._lock = threading.Lock()

    def find(self, path: str) -> PageFile | None:
        """Return a file, or None where there is none that the page may have.

        Parameters
        ----------
        path : str
            Below the folder, with slashes.
        """
        parts = path.split("/")
        content_type = _TEXT if parts[-1] == _LICENCE else _TYPES.get(PurePosixPath(path).suffix)
        if content_type is None or len(parts) > _MOST_PARTS or not all(_PART.fullmatch(part) for part in parts):
            return None
        found = self._root.joinpath(*parts)
        if not found.is_file() or not self._inside(found):
            return None
        version = _version(found)
        with self._lock:
            known = self._known.get(path)
        if known is not None and known[0] == version:
            return known[1]
        file = _read(found, content_type)
        with self._lock:
            self._known[path] = version, file
        return file

    def _inside(self, found: Traversable) -> bool:
        if not isinstance(found, Path) or not isinstance(self._root, Path):
            return True  # an archive, which has no links
        return found.resolve().is_relative_to(self._root.resolve())


def _version(found: Traversable) -> tuple[int, int]:
    """Tells a file that was written anew, as whoever works on the page does."""
    if not isinstance(found, Path):
        return (0, 0)
    status = found.stat()
    return status.st_mtime_ns, status.st_size


def _read(found: Traversable, content_type: str) -> PageFile:
    return page_file(found.read_bytes(), content_type)


def page_file(content: bytes, content_type: str) -> PageFile:
    """Return what is served for some bytes, compressed where that gains anything."""
    compressed = None
    if content_type not in _DENSE and len(content) >= _LEAST_COMPRESSED:
        # Without a time, so that the same file is the same bytes everywhere.
        smaller = gzip.compress(content, 6, mtime=0)
        compressed = smaller if len(smaller) < 0.95 * len(content) else None
    return PageFile(
        content=content,
        compressed=compressed,
        content_type=content_type,
        digest=hashlib.sha256(content).hexdigest(),
    )
