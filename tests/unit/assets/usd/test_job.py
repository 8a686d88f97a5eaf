"""`output.usd` of a real job: in a run, from the shell, by a worker; and where usd-core is not installed."""

from __future__ import annotations

import hashlib
import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from meshdeform.assets import build_glb, load_asset
from meshdeform.cli.app import app
from meshdeform.cli.exits import ExitCode
from meshdeform.errors import DependencyError
from meshdeform.geometry.shapes import icosphere
from meshdeform.record.models import JobState, NewJob, StoredFile
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run, text_deform
from tests.worker_world import World, new_world

needs_usd = pytest.mark.skipif(importlib.util.find_spec("pxr") is None, reason="needs usd-core (the extra usd)")
USDZ = "model/vnd.usdz+zip"


def glb(height: float = 1.0) -> bytes:
    mesh = icosphere(1)
    return build_glb(mesh.verts.numpy() * [1.0, height, 1.0], mesh.faces.numpy(), name="ball", material="clay")


def request(**output: bool) -> JobRequest:
    params = {"guidance": "target", "preset": "preview", "steps": 2}
    return JobRequest.model_validate({"params": params, "output": output})


def without_usd(patch: pytest.MonkeyPatch) -> None:
    real = importlib.util.find_spec
    patch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == "pxr" else real(name, *more))


@needs_usd
def test_two_steps_and_the_package_holds_the_result(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    run = text_deform.start(asset=glb(), filename="a.glb", request=request(usd=True), target=glb(2.0))
    assert len(list(run)) == 2
    artifacts = run.finish()
    assert set(artifacts) == {"result.glb", "result.usdz", "report.json", "preview.png"}
    usdz = artifacts["result.usdz"]
    assert usdz.content_type == USDZ
    report = json.loads(artifacts["report.json"].data)
    digest = hashlib.sha256(usdz.data).hexdigest()
    assert report["usd"] == {"bytes": len(usdz.data), "sha256": digest, "meshes": 1, "left_out": []}
    assert "usd-core" in report["versions"]
    (tmp_path / "result.usdz").write_bytes(usdz.data)
    stage = Usd.Stage.Open(str(tmp_path / "result.usdz"))
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/Root/ball/ball")).GetPointsAttr().Get())
    result = load_asset(artifacts["result.glb"].data).surface
    np.testing.assert_allclose(points, result.positions, atol=1e-6)
    assert not np.allclose(points, load_asset(glb()).surface.positions)


def test_without_usd_core_a_run_is_refused_before_anything_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    without_usd(monkeypatch)
    with pytest.raises(DependencyError, match="usd-core") as caught:
        text_deform.start(asset=b"nothing", filename="a.glb", request=request(usd=True))
    assert 'pip install -e ".[usd]"' in caught.value.advice_text


@needs_usd
def test_from_the_shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.glb").write_bytes(glb())
    (tmp_path / "egg.glb").write_bytes(glb(2.0))
    command = ["run", "a.glb", "--target", "egg.glb", "--preset", "preview", "--steps", "2", "--usd", "-o", "b.glb"]
    done = CliRunner().invoke(app, [*command, "--json"])
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["usd"] == "b.usdz"
    report = json.loads((tmp_path / "b.report.json").read_text())
    assert report["usd"]["sha256"] == hashlib.sha256((tmp_path / "b.usdz").read_bytes()).hexdigest()


@pytest.mark.parametrize("command", ["run", "batch"])
def test_the_shell_refuses_it_without_usd_core(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_usd(monkeypatch)
    monkeypatch.chdir(tmp_path)
    Path("a.glb").write_bytes(glb())
    prompt = ["a vase"] if command == "run" else ["--prompt", "a vase"]
    result = CliRunner().invoke(
        app, [command, "a.glb", *prompt, "--usd", "-o", "out.glb" if command == "run" else "out"]
    )
    assert result.exit_code == (ExitCode.UNAVAILABLE if command == "run" else ExitCode.BAD_INPUT)
    assert "usd-core" in result.output
    assert not list(tmp_path.rglob("*.usdz"))
    assert not list(tmp_path.rglob("out*.glb"))


def worked(world: World) -> Any:
    """Let a worker do a job that asks for USDZ; return the job."""

    def stored(key: str, data: bytes) -> StoredFile:
        put = world.store.put(key, data, "model/gltf-binary")
        return StoredFile(key=key, filename="a.glb", size=put.size, sha256=put.sha256)

    files = {"asset": stored("assets/a", glb()), "target": stored("assets/b", glb(2.0))}
    job = world.record.create(NewJob(request(usd=True), files))
    world.runner(start=start_run).run(job.id)
    return world.record.get(job.id)


@needs_usd
def test_a_worker_stores_it_as_an_artifact(tmp_path: Path) -> None:
    with new_world(tmp_path) as world:
        job = worked(world)
        assert (job.state, job.error) == (JobState.SUCCEEDED, None)
        (artifact,) = [each for each in world.record.artifacts(job.id) if each.name == "result.usdz"]
        data = world.store.get(artifact.key)
        assert artifact.content_type == USDZ
        assert (artifact.size, artifact.sha256) == (len(data), hashlib.sha256(data).hexdigest())
        assert data.startswith(b"PK")


def test_a_worker_without_usd_core_fails_the_job_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_usd(monkeypatch)
    with new_world(tmp_path) as world:
        job = worked(world)
        assert (job.state, job.progress.step) == (JobState.FAILED, 0)
        assert job.error.code == "dependency_missing"
        assert 'pip install -e ".[usd]"' in job.error.advice
        assert job.attempt == 1
