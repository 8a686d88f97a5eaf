"""The commands and the Python of docs/control.md, run in the order of the page with tiny steps and small assets."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from meshdeform.cli.app import app
from meshdeform.client import Client
from meshdeform.geometry.shapes import box
from meshdeform.requests.removed import grouped
from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Service
from tests.unit.assets.builders import Builder, unpack

ADDRESS = "http://127.0.0.1:8765"
QUICK = {"preset": "preview", "steps": 2}
SHORTER = {
    "run": ["--preset", "preview", "--steps", "2"],
    "batch": ["--preset", "preview", "--steps", "2"],
    "variants": ["--set", "steps=2"],
    "apply": [],
}


@pytest.fixture
def folder(tmp_path: Path, repository: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a reader, with every file that the page names."""
    (tmp_path / "examples").symlink_to(repository / "examples")
    (tmp_path / "sphere.glb").symlink_to(repository / "examples/sphere.glb")
    (tmp_path / "asset.glb").symlink_to(repository / "examples/capsule.glb")
    write_ellipsoid(tmp_path / "spot.obj", 1.2)
    cow = write_ellipsoid(tmp_path / "cow.obj", 0.8).read_text()
    # As long as the page's cow: its box takes the half with the head.
    (tmp_path / "cow.obj").write_text(re.sub(r"^v (\S+)", lambda x: f"v {4 * float(x[1])}", cow, flags=re.MULTILINE))
    (tmp_path / "lamp.glb").write_bytes(_lamp())
    rows, columns = np.mgrid[:64, :64]
    for name, wide in (("front", 24), ("side", 16)):
        inside = ((rows - 32) / 28) ** 2 + ((columns - 32) / wide) ** 2 < 1
        Image.fromarray(inside.astype(np.uint8) * 255).save(tmp_path / f"{name}.png")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path


def _lamp() -> bytes:
    """A stand with a plug, and a shade of brass."""
    builder = Builder()
    builder.root["materials"] = [{"name": "Wood"}, {"name": "Brass"}]
    parts = [
        ("Stand", 0, (0.2, 2.0, 0.2), [0.0, 0.0, 0.0]),
        ("Plug", 0, (0.3, 0.1, 0.1), [0.25, -0.9, 0.0]),
        ("Shade", 1, (0.8, 0.6, 0.8), [0.0, 1.2, 0.0]),
    ]
    for name, material, size, place in parts:
        mesh = box(4, size)
        primitive = builder.primitive(mesh.verts.numpy().astype(np.float32), mesh.faces.numpy().astype(np.uint16))
        builder.node(builder.mesh({**primitive, "material": material}, name=name), name=name, translation=place)
    return builder.glb()


def shown(page: str) -> list[tuple[str, str]]:
    """Return the page's blocks (language, text); JSON is validated by tests/unit/test_docs.py."""
    return re.findall(r"^```(sh|python)\n(.*?)^```", page, re.DOTALL | re.MULTILINE)


def quick_request(text: str) -> str:
    """Return a request with the settings of QUICK."""
    request = json.loads(text)
    return json.dumps({**request, "params": grouped({**request.get("params", {}), **QUICK})})


def run_command(words: list[str]) -> str:
    """Run a line of the shell that begins with `meshdeform`, in this process, which has loaded torch already."""
    done = CliRunner().invoke(app, [*words[1:], *SHORTER[words[1]]])
    assert done.exit_code == 0, f"{shlex.join(words)}\n{done.output}\n{done.exception!r}"
    for flag in ("-o", "--output"):
        if flag in words:
            assert Path(words[words.index(flag) + 1]).exists(), shlex.join(words)
    return done.output


def targets_of(path: Path) -> list[str]:
    root, _, _ = unpack(path.read_bytes())
    return list(root["meshes"][0]["extras"]["targetNames"])


@pytest.mark.acceptance
@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.long  # tests/unit/test_docs.py checks commands, flags and requests; tests/unit/runs, what they do
def test_the_examples_run_as_written(service: Service, folder: Path, repository: Path) -> None:
    url = str(service.http.base_url).rstrip("/")
    client, job = Client(url), None
    count = {"meshdeform": 0, "curl": 0, "python": 0}
    for language, text in shown((repository / "docs/control.md").read_text()):
        if language == "python":
            assert job is not None
            names: dict[str, Any] = {"client": client, "job": job}
            exec(compile(text.replace('params={"guid', 'params={"steps": 2, "guid'), "control.md", "exec"), names)
            count["python"] += 1
            continue
        for line in text.splitlines():
            words = shlex.split(line)
            count[words[0]] += 1
            if words[0] == "meshdeform":
                run_command(words)
                continue
            if job is None:  # the page's $ID: a finished job
                job = client.submit("sphere.glb", "a mushroom", params=QUICK)
                service.finished(job.id)
            words = [word.replace(ADDRESS, url).replace("$ID", job.id) for word in words]
            words = [
                f"request={quick_request(word.removeprefix('request='))}" if word.startswith("request=") else word
                for word in words
            ]
            done = subprocess.run(
                ["curl", "-sS", "--fail-with-body", *words[1:]], capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}\n{service.log[-3000:]}"
            if "-F" in words:
                found = service.finished(json.loads(done.stdout)["id"])
                assert found["state"] == "succeeded", found
    assert count == {"meshdeform": 15, "curl": 3, "python": 2}
    assert targets_of(folder / "mushroom.morph.glb")[-1] == "deform"
    assert (folder / "mushroom-60.glb").read_bytes()[:4] == b"glTF"
    assert len(targets_of(next((folder / "out").glob("*.targets.glb")))) == 2
