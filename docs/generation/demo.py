"""Build the page as static files for any web host: `python -m docs.generation.demo FOLDER`.

FOLDER gets the page with its examples, `embed.html`, and `recorded/`: what the service answers about a job that this
command runs. Nothing of it needs a server (service/web/app/demo.js).
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx

from meshdeform.client import Client

__all__ = ["build", "record"]

_WEB = Path(__file__).resolve().parents[2] / "service/web"
_ASSET = _WEB / "examples/animal.glb"
_REQUEST = {"prompt": "a giraffe"}
_PLAY_MS = 12_000
_NAV = re.compile(r'(<nav aria-label="Main">).*?(</nav>)', re.DOTALL)
_EMBED = """<!doctype html>
<html lang="en">
  <meta charset="utf-8" />
  <meta name="viewport" content="width=device-width" />
  <title>A vase becomes a lamp</title>
  <script type="module" src="web/viewer/embed.js"></script>
  <meshdeform-result
    source="web/examples/vase.glb"
    result="web/examples/gallery/lamp.glb"
    label="A vase becomes a lamp"
    style="max-width: 720px"
  ></meshdeform-result>
</html>
"""


def build(folder: Path, http: httpx.Client, job_id: str) -> None:
    """Write the page into a folder, with a finished job of the service that `http` reaches."""
    shutil.copytree(_WEB, folder / "web", dirs_exist_ok=True, ignore=shutil.ignore_patterns("index.html"))
    links = {
        "#/examples": ("examples", "Examples"),
        f"#/shared/{job_id}/link.recorded": ("shared", "A job"),
        "#/field": ("create", "A .ndf"),
        "../index.html": ("", "Documentation"),
    }
    nav = "".join(f'<a href="{href}" data-view="{view}">{label}</a>' for href, (view, label) in links.items())
    page = (_WEB / "index.html").read_text(encoding="utf-8").replace("<html ", f'<html data-demo="{_PLAY_MS}" ')
    (folder / "index.html").write_text(_NAV.sub(rf"\1{nav}\2", page), encoding="utf-8")
    (folder / "embed.html").write_text(_EMBED, encoding="utf-8")
    record(folder / "recorded", http, job_id)


def record(folder: Path, http: httpx.Client, job_id: str) -> None:
    """Write what the service answers about a finished job, each answer into a file named after its path."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in _paths(http, f"v1/jobs/{job_id}"):
        answer = http.get(f"/{path}").raise_for_status()
        (folder / path.replace("/", "~")).write_bytes(answer.content)


def _paths(http: httpx.Client, job: str) -> Iterator[str]:
    yield from (job, f"{job}/events", f"{job}/asset", f"{job}/artifacts", f"{job}/checkpoints")
    for artifact in http.get(f"/{job}/artifacts").json()["artifacts"]:
        yield f"{job}/artifacts/{artifact['name']}"
    for checkpoint in http.get(f"/{job}/checkpoints").json()["checkpoints"]:
        if checkpoint["mesh"]:
            yield f"{job}/checkpoints/{checkpoint['step']}/mesh.glb"


def _serve_and_build(folder: Path) -> None:
    """Run a service of its own, and a job on it."""
    with tempfile.TemporaryDirectory() as data:
        command = [sys.executable, "-m", "meshdeform", "serve", "--json", "--port", "0", "--data-dir", data]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as service:
            try:
                url = _url(service)
                with Client(url) as client, httpx.Client(base_url=url, timeout=60) as http:
                    job = client.wait(client.submit(_ASSET, **_REQUEST))
                    build(folder, http, job.id)
            finally:
                service.terminate()


def _url(service: subprocess.Popen[str]) -> str:
    assert service.stdout is not None
    for line in service.stdout:
        found: dict[str, Any] = json.loads(line)
        if found.get("event") == "ready":
            return str(found["url"])
    raise SystemExit("The service did not start.")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    _serve_and_build(parser.parse_args().folder)
