"""Try a release before it is public: upload it to an index and a registry on this machine, and install it from there.

    python -m release.rehearsal                # builds it first
    python -m release.rehearsal --dist dist    # of files that are there

Nothing leaves the machine. twine uploads where it is installed, as the release itself will; otherwise the same form is
sent without it. What the wheel depends on comes from this environment. Image tags need Docker and are not tried.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from sysconfig import get_path
from threading import Thread
from typing import Any

import httpx
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from meshdeform import __version__
from release.build import build

__all__ = ["main", "rehearse", "serving"]

_NAME = "meshdeform"
_OPEN = "import('meshdeform').then(({ Client }) => { if (typeof Client !== 'function') process.exit(1); })"


def rehearse(dist: Path, said: Callable[[str], None] = print) -> None:
    """Upload the files of a release and install them again.

    Parameters
    ----------
    dist : Path
        As `release.build` writes it.
    said : callable
        Told each step that has passed, with its seconds.

    Raises
    ------
    SystemExit
        A step failed; the message is its output.
    """
    with tempfile.TemporaryDirectory() as aside, serving(Path(aside) / "held") as url:
        folder = Path(aside)
        steps: list[tuple[str, Callable[[], None]]] = [
            ("the checksums are those of the files", lambda: _check_sums(dist)),
            ("wheel and source distribution are uploaded", lambda: _upload(dist, url)),
            ("the wheel is installed from the index and runs", lambda: _install(folder / "venv", url)),
            ("the TypeScript client is published", lambda: _publish(dist, folder, url)),
            ("the TypeScript client is installed from the registry and opens", lambda: _add(folder)),
        ]
        for words, step in steps:
            start = time.monotonic()
            step()
            said(f"{time.monotonic() - start:6.1f} s  {words}")


@contextmanager
def serving(held: Path) -> Iterator[str]:
    """Serve a package index (PEP 503, with uploads) and an npm registry, and yield their address."""
    held.mkdir(parents=True)
    server = uvicorn.Server(uvicorn.Config(_registry(held), port=0, log_level="error"))
    thread = Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started and thread.is_alive():
        thread.join(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    yield f"http://127.0.0.1:{port}"
    server.should_exit = True
    thread.join()


def _registry(held: Path) -> Starlette:
    documents: dict[str, dict[str, Any]] = {}

    async def upload(request: Request) -> Response:
        async with request.form() as form:
            file: Any = form["content"]
            data, digest = await file.read(), form["sha256_digest"]
        if digest != hashlib.sha256(data).hexdigest():
            return PlainTextResponse("The file is not the one that was announced.", 400)
        (held / file.filename).write_bytes(data)
        return PlainTextResponse("")

    def index(_: Request) -> Response:
        files = [path for path in sorted(held.iterdir()) if path.suffix in {".whl", ".gz"}]
        link = '<a href="/files/{0}#sha256={1}">{0}</a>'
        return HTMLResponse("".join(link.format(path.name, _digest(path)) for path in files))

    async def publish(request: Request) -> Response:
        document = await request.json()
        for name, each in document.pop("_attachments").items():
            (held / name).write_bytes(base64.b64decode(each["data"]))
        for each in document["versions"].values():
            name = each["dist"]["tarball"].rpartition("/")[2]
            each["dist"]["tarball"] = str(request.url_for("file", name=name))
        documents[document["name"]] = document
        return JSONResponse({"ok": True}, 201)

    def package(request: Request) -> Response:
        found = documents.get(request.path_params["name"])
        return JSONResponse(found) if found else JSONResponse({"error": "not found"}, 404)

    def file(request: Request) -> Response:
        return FileResponse(held / Path(request.path_params["name"]).name)

    routes = [
        Route("/legacy/", upload, methods=["POST"]),
        Route(f"/simple/{_NAME}/", index),
        Route("/files/{name}", file),
        Route("/npm/{name}", publish, methods=["PUT"]),
        Route("/npm/{name}", package),
    ]
    return Starlette(routes=routes)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _check_sums(dist: Path) -> None:
    for line in (dist / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split("  ")
        if _digest(dist / name) != digest:
            raise SystemExit(f"release/rehearsal.py: {name} is not the file of SHA256SUMS.")


def _upload(dist: Path, url: str) -> None:
    files = [*dist.glob("*.whl"), *dist.glob("*.tar.gz")]
    if importlib.util.find_spec("twine"):
        command = [sys.executable, "-m", "twine", "upload", "--non-interactive", "--repository-url", f"{url}/legacy/"]
        _run([*command, "-u", "rehearsal", "-p", "rehearsal", *(str(path.resolve()) for path in files)], dist)
        return
    for path in files:
        form = {":action": "file_upload", "protocol_version": "1", "name": _NAME, "sha256_digest": _digest(path)}
        httpx.post(f"{url}/legacy/", data=form, files={"content": (path.name, path.read_bytes())}).raise_for_status()


def _install(folder: Path, url: str) -> None:
    venv.create(folder, with_pip=False)
    python = folder / "bin/python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "-q", "--no-deps", "--no-cache-dir"]
    _run([*pip, "--index-url", f"{url}/simple/", f"{_NAME}=={__version__}"], folder)
    (site,) = folder.glob("lib/*/site-packages")
    (site / "others.pth").write_text(get_path("purelib") + "\n")
    _run([str(python), "-P", "-c", f"import meshdeform; assert meshdeform.__file__.startswith({str(site)!r})"], folder)
    _run([str(folder / "bin/meshdeform"), "version"], folder)


def _publish(dist: Path, folder: Path, url: str) -> None:
    (folder / "npmrc").write_text(f"registry={url}/npm/\n{url.removeprefix('http:')}/npm/:_authToken=rehearsal\n")
    (tarball,) = dist.glob("*.tgz")
    _npm(folder, "publish", str(tarball.resolve()), "--tag", "latest")


def _add(folder: Path) -> None:
    project = folder / "project"
    project.mkdir()
    (project / "package.json").write_text(json.dumps({"private": True, "type": "module"}))
    _npm(folder, "install", f"{_NAME}@{__version__}", "--no-audit", "--no-fund", "--prefix", str(project))
    _run(["node", "-e", _OPEN], project)


def _npm(folder: Path, *words: str) -> None:
    npm = shutil.which("npm")
    if npm is None:
        raise SystemExit("release/rehearsal.py: npm is not installed; the TypeScript client is part of a release.")
    _run([npm, *words, "--userconfig", str(folder / "npmrc"), "--cache", str(folder / "cache")], folder)


def _run(command: list[str], folder: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"release/rehearsal.py: {' '.join(command)} failed:\n{done.stdout}{done.stderr}")


def main() -> None:
    """Rehearse a release; the exit status is 1 where a step fails."""
    parser = argparse.ArgumentParser(description="Upload a release to this machine, and install it from there.")
    parser.add_argument("--dist", type=Path, help="files of a release (default: build them)")
    given = parser.parse_args().dist
    if given:
        rehearse(given)
        return
    with tempfile.TemporaryDirectory() as aside:
        build(Path(aside))
        rehearse(Path(aside))


if __name__ == "__main__":
    main()
