"""The programs that the page offers to copy: curl and Python run against a real service, TypeScript fits the types."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.fake_kind import FakeKind
from tests.integration.conftest import Api, serving_api
from tests.typescript_package import built_package
from tests.worker_world import working

NAMES = ["a ball.glb", 'it\'s "a"; ball,.glb']
PROMPT = 'it\'s "half" $HOME `id` \\ ;type=x the sphere'
PARAMS = {
    "seed": 7,
    "guidance": {"kind": "exemplar", "source_noun": "pumpkin", "orientation": 0},
    "control": {"rigid": []},
}
DOCUMENT = {"prompt": "a mushroom", "params": PARAMS, "metadata": {"shot": PROMPT}, "output": {"morph": False}}
PREVIEW = {"prompt": "half the size", "params": {"guidance": PARAMS["guidance"]}, "seeds": [3, 4]}


@pytest.fixture(scope="module")
def keyed(own_settings: Callable[..., Settings]) -> Iterator[tuple[Api, str]]:
    """A service that wants keys, and a key."""
    with serving_api(own_settings(auth="on")) as api:
        yield api, api.record.keys.create("ann")[1]


def programs(repository: Path, *requests: dict[str, Any]) -> list[dict[str, str]]:
    """What the page shows for requests."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    command = [node, str(repository / "tests/node/snippets.mjs"), json.dumps(requests)]
    found: list[dict[str, str]] = json.loads(subprocess.check_output(command, text=True))
    return found


def run(program: str, language: str, folder: Path, key: str) -> None:
    """Run a program as whoever copies it would, with a key in place of the dots."""
    command = ["sh", "-c", program.replace("mdk_...", key)] if language == "curl" else [sys.executable, "-c", program]
    environment = {**os.environ, "MESHDEFORM_API_KEY": key}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stdout + done.stderr


@each_case("language", ["curl", "Python"])
def test_what_is_copied_makes_the_job_and_brings_its_result(
    keyed: tuple[Api, str], repository: Path, sphere: bytes, tmp_path: Path, language: str
) -> None:
    api, key = keyed
    wanted = [{"document": DOCUMENT, "files": {"asset": name}, "baseUrl": api.url, "keyed": True} for name in NAMES]
    headers = {"Authorization": f"Bearer {key}"}
    before = len(api.http.get("/v1/jobs", headers=headers).json()["jobs"])
    with working(api.settings, FakeKind().start):
        for name, request in zip(NAMES, wanted, strict=True):
            (tmp_path / name).write_bytes(sphere)
            run(programs(repository, request)[0][language], language, tmp_path, key)
            made = f"{name[:-4]}-deformed"
            found = tmp_path / (f"{made}.glb" if language == "curl" else f"{made}/result.glb")
            assert found.read_bytes().isdigit(), "what the fake kind makes"
        made_jobs = api.http.get("/v1/jobs", headers=headers).json()["jobs"]
        assert len(made_jobs) == before + len(NAMES)
        sent = {job["files"]["asset"]["filename"] for job in made_jobs[: len(NAMES)]}
        assert {name.replace("%22", '"') for name in sent} == set(NAMES), "curl sends quotes as browsers do"
        for job in made_jobs[: len(NAMES)]:
            assert {name: job[name] for name in ("prompt", "metadata", "params")} == {
                name: DOCUMENT[name] for name in ("prompt", "metadata", "params")
            }
        # The result of a job as the next one's asset, which no file brings.
        again = {"job_id": made_jobs[0]["id"], "artifact": "result.glb"}
        program = programs(repository, {**wanted[0], "files": {"asset": again}, "keyed": True})[0][language]
        assert json.dumps(again["job_id"]) in program


@each_case("language", ["curl", "Python"])
def test_what_is_copied_of_a_preview_writes_its_shape(
    keyed: tuple[Api, str], repository: Path, sphere: bytes, tmp_path: Path, language: str
) -> None:
    api, key = keyed
    (tmp_path / "ball.glb").write_bytes(sphere)
    request = {"document": PREVIEW, "files": {"asset": "ball.glb"}, "preview": True, "baseUrl": api.url, "keyed": True}
    run(programs(repository, request)[0][language], language, tmp_path, key)
    before, after = (load_asset(data).surface for data in (sphere, (tmp_path / "ball-preview.glb").read_bytes()))
    assert 0.4 < np.ptp(after.positions) / np.ptp(before.positions) < 0.9


def test_what_is_copied_in_typescript_fits_the_types(repository: Path, tmp_path: Path) -> None:
    package = built_package(repository, tmp_path).parent
    modules = tmp_path / "node_modules"
    modules.mkdir()
    (modules / "meshdeform").symlink_to(package)
    (modules / "@types").symlink_to(repository / "tests/node/node_modules/@types")
    stored = {"job_id": "job_1", "artifact": "result.glb"}
    requests: list[dict[str, Any]] = [
        {"document": DOCUMENT, "files": {"asset": NAMES[1], "silhouette_1": "front.png"}, "keyed": True},
        {"document": {"params": {}, "files": {"asset": stored}}, "files": {"target": "vase.glb"}},
        {"document": PREVIEW, "files": {"asset": stored}, "preview": True},
        {"document": {"kind": "family_fit"}, "files": {"meshes": "chairs.zip"}, "artifact": "family.safetensors"},
        {"document": {"prompt": 3}, "files": {"asset": "ball.glb"}},
    ]
    for number, made in enumerate(programs(repository, *requests)):
        (tmp_path / f"copied{number}.mts").write_text(made["TypeScript"])
    compiler = repository / "tests/node/node_modules/typescript/bin/tsc"
    options = ["--noEmit", "--strict", "--skipLibCheck", "--target", "es2022", "--module", "nodenext"]
    options += ["--lib", "es2023,dom,dom.iterable,dom.asynciterable", "--types", "node"]
    command = [shutil.which("node") or "node", compiler, *options, *sorted(tmp_path.glob("*.mts"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=240, cwd=tmp_path)
    wrong = [line for line in done.stdout.splitlines() if not line.startswith("copied4.mts")]
    assert not wrong, done.stdout
    assert "Type 'number' is not assignable to type 'string'" in done.stdout, "a wrong document is found"
