"""Build the page as static files for any web host: `python -m docs.generation.demo FOLDER`.

FOLDER gets the page with its examples, `embed.html`, and `recorded/`: what the service answers about a job that this
command runs (service/web/app/demo.js), and of each example other designs, and its parts changed
(service/web/app/examples/moves.js). Nothing of it needs a server.
"""

from __future__ import annotations

import argparse
import base64
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

__all__ = ["build", "moves", "record"]

_WEB = Path(__file__).resolve().parents[2] / "service/web"
_ASSET = _WEB / "examples/animal.glb"
_REQUEST = {"prompt": "a giraffe"}
_PLAY_MS = 12_000
_MEMBERS, _PARTS, _PERCENT = 6, 6, 50
_EXAMPLES = json.loads((_WEB / "examples/gallery.json").read_text(encoding="utf-8"))["examples"]
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


def build(folder: Path, http: httpx.Client, job_id: str, examples: list[dict[str, Any]] = _EXAMPLES) -> None:
    """Write the page into a folder, with a finished job of the service that `http` reaches, and moves of examples."""
    shutil.copytree(_WEB, folder / "web", dirs_exist_ok=True, ignore=shutil.ignore_patterns("index.html"))
    links = {
        "#/examples": ("examples", "Examples"),
        f"#/shared/{job_id}/link.recorded": ("shared", "How it is made"),
        "#/field": ("create", "A field"),
        "../index.html": ("", "Documentation"),
    }
    nav = "".join(f'<a href="{href}" data-view="{view}">{label}</a>' for href, (view, label) in links.items())
    page = (_WEB / "index.html").read_text(encoding="utf-8").replace("<html ", f'<html data-demo="{_PLAY_MS}" ')
    (folder / "index.html").write_text(_NAV.sub(rf"\1{nav}\2", page), encoding="utf-8")
    (folder / "embed.html").write_text(_EMBED, encoding="utf-8")
    record(folder / "recorded", http, job_id)
    for example in examples:
        (folder / "recorded" / f"{example['id']}.json").write_text(json.dumps(moves(http, example)), encoding="utf-8")


def moves(http: httpx.Client, example: dict[str, Any]) -> dict[str, Any]:
    """Return designs of an example, and its parts changed, as previews: service/web/app/examples/moves.js reads it."""
    asset = (example["asset"], (_WEB / "examples" / example["asset"]).read_bytes())
    document = {"prompt": example["document"]["prompt"], "params": example["document"]["params"]}
    found = _posted(http, "v1/jobs:parts", asset, {}).json()["parts"]
    changed = [part for part in found if part["changes"]][:_PARTS]
    members = _posted(http, "v1/jobs:preview?as=positions", asset, {**document, "seeds": [*range(_MEMBERS)]}).content
    header = json.loads(members[12 : 12 + int.from_bytes(members[8:12], "little")])
    if header["change"]:  # in plain words, which is the same with every seed
        members = b""
    told = (_part(http, asset, document["params"], part) for part in changed)
    return {"members": base64.b64encode(members).decode(), "parts": [part for part in told if part]}


def _part(
    http: httpx.Client, asset: tuple[str, bytes], params: dict[str, Any], part: dict[str, Any]
) -> dict[str, Any] | None:
    """Return one part of an asset, and what its first change makes; None where the asset refuses that."""
    change = part["changes"][0]
    request = {"prompt": f"{part['name']} {change['more']} by {_PERCENT} %", "params": {"guidance": params["guidance"]}}
    form = "glb" if b"JOINTS_0" in asset[1] else "positions"  # joints move along
    try:
        shape = _posted(http, f"v1/jobs:preview?as={form}", asset, request).content
    except httpx.HTTPStatusError as error:
        if error.response.status_code != httpx.codes.UNPROCESSABLE_ENTITY:
            raise
        return None
    shown = {name: part[name] for name in ("name", "faces")}
    return {**shown, "more": f"{change['more']} by {_PERCENT}%", "shape": {form: base64.b64encode(shape).decode()}}


def _posted(http: httpx.Client, path: str, asset: tuple[str, bytes], document: dict[str, Any]) -> httpx.Response:
    files = {"asset": asset, "request": (None, json.dumps(document), "application/json")}
    return http.post(f"/{path}", files=files, timeout=600).raise_for_status()


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
