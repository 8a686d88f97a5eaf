"""A page with nothing but viewers, under the policy that the service's page has, and the files that it shows."""

from __future__ import annotations

import mimetypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urlsplit

POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self' blob: data:; worker-src 'self' blob:; font-src 'self'; manifest-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
PAGE = Path(__file__).parent / "page"


class ViewerSite:
    """Serves the viewer's modules, the page and `files` (at `/files/<name>`) on loopback."""

    def __init__(self, web: Path) -> None:
        self.files: dict[str, bytes] = {}
        site = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                path = unquote(urlsplit(self.path).path)
                data = site.find(path, web)
                self.send_response(404 if data is None else 200)
                kind = mimetypes.guess_type(path)[0] or "application/octet-stream"
                kind = {".js": "text/javascript", ".wasm": "application/wasm"}.get(Path(path).suffix, kind)
                self.send_header("Content-Type", "text/html" if path == "/" else kind)
                self.send_header("Content-Length", str(len(data or b"")))
                self.send_header("Content-Security-Policy", POLICY)
                self.send_header("X-Content-Type-Options", "nosniff")
                self.end_headers()
                self.wfile.write(data or b"")

            def log_message(self, *args: object) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}"

    def find(self, path: str, web: Path) -> bytes | None:
        """The body for a path, None where there is none."""
        for start, folder in (("/web/", web), ("/page/", PAGE)):
            if path.startswith(start):
                file = (folder / path.removeprefix(start)).resolve()
                return file.read_bytes() if file.is_file() and file.is_relative_to(folder.resolve()) else None
        if path.startswith("/files/"):
            return self.files.get(path.removeprefix("/files/"))
        return (PAGE / "index.html").read_bytes() if path == "/" else None


@contextmanager
def serving_viewers(web: Path) -> Iterator[ViewerSite]:
    """Run the site while the block runs."""
    site = ViewerSite(web)
    thread = threading.Thread(target=site.server.serve_forever, daemon=True)
    thread.start()
    try:
        yield site
    finally:
        site.server.shutdown()
        site.server.server_close()
        thread.join()
