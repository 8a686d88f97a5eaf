"""A page with nothing but viewers, under the policy that the service's page has, and the files that it shows."""

from __future__ import annotations

import mimetypes
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

if TYPE_CHECKING:
    from playwright.sync_api import Route

POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' blob: data:; connect-src 'self' blob: data:; worker-src 'self' blob:"
)
WEB = Path(__file__).parents[3] / "service" / "web"
SCRIPT = Path(__file__).parent / "page.js"
PAGE = """<!doctype html>
<html lang="en">
  <title>Viewer</title>
  <link rel="icon" href="data:," />
  <style>
    :root { color-scheme: light dark; }
    body { margin: 0; background: light-dark(#fff, #111); }
    #stage { display: flex; flex-wrap: wrap; }
    .viewer { width: 160px; height: 120px; }
  </style>
  <main id="stage"></main>
  <script type="module" src="/page.js"></script>
</html>"""


SMALLER = {b"SIZE = 480": b"SIZE = 96", b"FRAMES = 48": b"FRAMES = 12"}
"""What a turntable is here: to draw it as it ships takes software longer than everything else."""


class ViewerSite:
    """Answers what the browser asks: the viewer's modules, the page and `files` (at `/files/<name>`)."""

    url = "http://viewers.test"

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}

    def answer(self, route: Route) -> None:
        """Answer a request as a host of files does."""
        path = unquote(urlsplit(route.request.url).path)
        kind = {".js": "text/javascript", ".wasm": "application/wasm"}.get(Path(path).suffix)
        kind = kind or mimetypes.guess_type(path)[0] or ("text/html" if path == "/" else "application/octet-stream")
        found = self._find(path)
        headers = {"Content-Type": kind, "Content-Security-Policy": POLICY, "X-Content-Type-Options": "nosniff"}
        route.fulfill(status=404 if found is None else 200, headers=headers, body=found or b"")

    def _find(self, path: str) -> bytes | None:
        if path.startswith("/web/"):
            file = WEB / path.removeprefix("/web/")
            return smaller(file) if file.is_file() else None
        known = {"/": PAGE.encode(), "/page.js": SCRIPT.read_bytes()}
        return known.get(path, self.files.get(path.removeprefix("/files/")))


def smaller(file: Path) -> bytes:
    """Return the content of a file, of the turntable's script one that draws less."""
    content = file.read_bytes()
    if file.name == "turntable.js":
        for shipped, less in SMALLER.items():
            assert shipped in content
            content = content.replace(shipped, less)
    return content
