"""The recipes of docs/recipes.md, run against a real service."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from meshdeform.assets import load_asset
from meshdeform.requests.document import JobRequest
from tests.acceptance.service import Service, until
from tests.servers import free_port

REQUEST = '{"prompt": "a mushroom", "params": {"preset": "preview", "steps": 2, "seed": 7}}'


@pytest.fixture(scope="module")
def recipes(repository: Path) -> Path:
    """The folder of the recipes, each of which the page has."""
    folder = repository / "examples/recipes"
    page = (repository / "docs/recipes.md").read_text()
    shown = re.findall(r"^<!-- file: examples/recipes/(\S+) -->$", page, re.MULTILINE)
    assert {*shown, "request.json"} == {path.name for path in folder.iterdir() if path.is_file()}
    JobRequest.model_validate_json((folder / "request.json").read_text())
    return folder


@pytest.fixture
def project(tmp_path: Path, repository: Path) -> Path:
    """A folder with two assets and a request."""
    (tmp_path / "assets").mkdir()
    for name in ("cube", "vase"):
        shutil.copy(repository / f"examples/{name}.glb", tmp_path / "assets")
    (tmp_path / "request.json").write_text(REQUEST)
    return tmp_path


def environment(service: Service | None = None, **more: str) -> dict[str, str]:
    url = {"MESHDEFORM_URL": str(service.http.base_url).rstrip("/")} if service else {}
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, **url, "PATH": path, "OMP_NUM_THREADS": "1", **more}


def needs(*programs: str) -> None:
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")


def job_count(service: Service) -> int:
    return len(service.http.get("/v1/jobs?limit=200").json()["jobs"])


def is_deformed(result: Path, source: Path) -> bool:
    before, after = (load_asset(path.read_bytes()).surface for path in (source, result))
    assert len(before.triangles) == len(after.triangles)
    # What a tool has compressed has another number of vertices.
    return before.positions.shape != after.positions.shape or bool(abs(before.positions - after.positions).max() > 1e-6)


def run(command: list[str], folder: Path, service: Service | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, cwd=folder, env=environment(service), capture_output=True, text=True, check=False, timeout=120
    )


def test_the_folder_recipe_posts_once_and_starts_again_where_it_was(
    recipes: Path, project: Path, service: Service
) -> None:
    needs("curl", "jq")
    shutil.copy(recipes / "deform-all", project)
    command = ["bash", "deform-all"]
    before = job_count(service)
    first = run(command, project, service)
    assert first.returncode == 0, first.stderr
    assert sorted(first.stdout.split()) == ["deformed/cube.glb", "deformed/vase.glb"]
    for name in ("cube.glb", "vase.glb"):
        assert is_deformed(project / "deformed" / name, project / "assets" / name)
    assert job_count(service) == before + 2
    second = run(command, project, service)
    assert (second.returncode, second.stdout) == (0, "")
    (project / "deformed/cube.glb").unlink()  # as if it had been stopped before
    assert run(command, project, service).stdout.split() == ["deformed/cube.glb"]
    assert job_count(service) == before + 2
    (project / "request.json").write_text(REQUEST.replace("a mushroom", "a quixotic zeitgeist"))
    refused = run(command, project, service)
    assert refused.returncode != 0
    assert "prompt_unknown_words" in refused.stdout + refused.stderr


def test_the_makefile_deforms_what_is_new(recipes: Path, project: Path) -> None:
    needs("make")
    shutil.copy(recipes / "Makefile", project)
    (project / "assets/vase.glb").unlink()
    (project / "assets/cube.txt").write_text("a mushroom\n")
    command = ["make", "PRESET=preview", "FLAGS=--steps 2"]
    first = run(command, project)
    assert first.returncode == 0, first.stderr
    assert is_deformed(project / "deformed/cube.glb", project / "assets/cube.glb")
    assert "Nothing to be done" in run(command, project).stdout


def test_the_gltf_transform_pipeline(recipes: Path, project: Path, service: Service, repository: Path) -> None:
    needs("node")
    modules = repository / "tests/node/node_modules"
    if not (modules / "@gltf-transform/functions").is_dir():
        pytest.skip("glTF-Transform is not installed (npm install --prefix tests/node)")
    (project / "node_modules").symlink_to(modules)
    shutil.copy(recipes / "deform.mjs", project)
    command = ["node", "deform.mjs", "assets/cube.glb", "out.glb"]
    done = run(command, project, service)
    assert done.returncode == 0, done.stderr
    assert is_deformed(project / "out.glb", project / "assets/cube.glb")
    assert "EXT_meshopt_compression" in (project / "out.glb").read_bytes().decode("latin-1")
    (project / "request.json").write_text('{"prompt": "a quixotic zeitgeist"}')
    refused = run(command, project, service)
    assert refused.returncode != 0
    assert "prompt_unknown_words" in refused.stderr


@contextmanager
def listening(command: list[str], folder: Path, port: int, **variables: str) -> Iterator[list[str]]:
    """Run a receiver; give the lines that it prints."""
    lines: list[str] = []
    child = subprocess.Popen(
        command, cwd=folder, env=environment(**variables), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert child.stdout is not None
    reader = threading.Thread(target=lines.extend, args=(child.stdout,))
    reader.start()

    def answers() -> bool:
        assert child.poll() is None, lines
        try:
            return httpx.post(f"http://127.0.0.1:{port}/meshdeform", content=b"{}").status_code == 401
        except httpx.TransportError:
            return False

    try:
        until("the receiver refuses what is not signed", answers)
        yield lines
    finally:
        child.terminate()
        child.wait()
        reader.join()
        child.stdout.close()


@pytest.mark.parametrize("kind", ["FastAPI", "Node"])
def test_the_webhook_receivers(kind: str, recipes: Path, project: Path, service: Service, repository: Path) -> None:
    needs(*(["node"] if kind == "Node" else []))
    port = free_port()
    made = service.http.post("/v1/webhooks", json={"url": f"http://127.0.0.1:{port}/meshdeform"}).json()
    name = "receiver.mjs" if kind == "Node" else "receiver.py"
    shutil.copy(recipes / name, project)
    uvicorn = [sys.executable, "-m", "uvicorn", "receiver:app", "--port", str(port), "--no-access-log"]
    command = ["node", name] if kind == "Node" else uvicorn
    with listening(command, project, port, WEBHOOK_SECRET=made["secret"], PORT=str(port)) as lines:
        job = service.submit(project / "assets/cube.glb", {"prompt": "a mushroom", "params": {"steps": 1}})
        assert service.finished(job)["state"] == "succeeded"
        told = f"finished {job} succeeded\n"
        until("the receiver is told", lambda: told in lines)
        deliveries = f"/v1/webhooks/{made['id']}/deliveries"
        listed = service.http.get(deliveries).json()["deliveries"]
        (done,) = (each for each in listed if each["type"] == "job.succeeded")
        again = service.http.post(f"{deliveries}/{done['id']}/replay").json()
        replayed = f"{deliveries}/{again['id']}"
        until("it takes the replay", lambda: service.http.get(replayed).json()["state"] == "delivered")
        assert lines.count(told) == 1
    service.http.delete(f"/v1/webhooks/{made['id']}")
