"""Jobs of kind `text_deform` on surfaces without triangles: the mesh that is fitted first, and where it is kept."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import safetensors.torch
from typer.testing import CliRunner

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.build import build_glb
from meshdeform.cli.app import app
from meshdeform.errors import AssetTooLargeError, CheckpointError
from meshdeform.geometry.shapes import icosphere
from meshdeform.requests.document import JobRequest
from meshdeform.runs import fitted_source as source_module
from meshdeform.runs import start_run
from meshdeform.runs.base import ArtifactData, InputFile, JobRun, RunInput
from meshdeform.runs.report import sha256_hex
from meshdeform.runs.text_deform_kind import read_source
from meshdeform.testing import FakePrior
from tests.unit.runs.test_surface_fit import octahedron


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make fits small; two things stay as they are: that a field is fitted, and what becomes of it."""
    for name, value in {"BASE_FACES": 100, "STEPS": 12, "BATCH_FACES": 16, "LEVEL": 1}.items():
        monkeypatch.setattr(source_module, name, value)
    monkeypatch.setattr("meshdeform.fields.surface_sources._POINT_CELLS", 24)
    monkeypatch.setattr("meshdeform.fields.surface_sources._CELLS", 20)


def cloud() -> bytes:
    points = icosphere(3).verts.numpy()
    out = io.StringIO()
    np.savetxt(out, np.concatenate([2 * points, points], 1), fmt="%.5f")
    return out.getvalue().encode()


def ring_grid() -> bytes:
    """Return the signed distances of a torus of radii 1 and 0.4."""
    axis = -1.6 + 0.1 * np.arange(33)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    out = io.BytesIO()
    np.savez(out, sdf=np.hypot(np.hypot(x, y) - 1, z) - 0.4, origin=np.full(3, -1.6), spacing=0.1)
    return out.getvalue()


def given(data: bytes, name: str, *, shown: dict[str, ArtifactData] | None = None, **more: object) -> RunInput:
    options = {"steps": 4, "preset": "preview", "orientation": "keep", **more.pop("params", {})}  # type: ignore[dict-item]
    request = JobRequest.model_validate({"prompt": "an egg", "params": options})
    shown = {} if shown is None else shown
    return RunInput(
        request,
        {"asset": InputFile(data, name)},
        load_prior=lambda _model: FakePrior(),
        on_artifact=shown.__setitem__,
        **more,  # type: ignore[arg-type]
    )


def through(run: JobRun) -> dict[str, ArtifactData]:
    list(run)
    return run.finish()


@pytest.mark.as_shipped
def test_points_become_a_mesh_that_is_deformed_and_reported() -> None:
    shown: dict[str, ArtifactData] = {}
    phases: list[str] = []
    found = through(start_run(given(cloud(), "ball.xyz", shown=shown, on_phase=phases.append)))
    assert list(shown) == ["source.glb"]
    assert "surface" in phases
    before, after = (load_asset(each.data).surface for each in (shown["source.glb"], found["result.glb"]))
    assert np.linalg.norm(before.positions, axis=1).mean() == pytest.approx(2, abs=0.05)
    assert np.array_equal(before.triangles, after.triangles)
    assert np.abs(before.positions - after.positions).max() > 1e-3
    report = json.loads(found["report.json"].data)
    assert (report["input"]["filename"], report["input"]["sha256"]) == ("ball.xyz", sha256_hex(cloud()))
    about = report["surface"]
    assert (about["described_by"], about["genus"], about["components"], about["steps"]) == ("points", 0, 1, 12)
    assert about["triangles"] == len(before.triangles) == 4 * about["base_faces"]
    assert about["sha256"] == sha256_hex(shown["source.glb"].data)
    assert 0 < about["distance"]["mean"] < 0.02


def test_a_resumed_run_and_a_branch_deform_the_mesh_of_their_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: dict[str, ArtifactData] = {}
    run = start_run(given(cloud(), "ball.xyz", shown=shown))
    steps = iter(run)
    next(steps)
    next(steps)
    state = run.checkpoint()
    list(steps)
    uninterrupted = run.finish()

    again: dict[str, ArtifactData] = {}
    monkeypatch.setattr(source_module, "surface_of", lambda _found: pytest.fail("the surface was fitted again"))
    resumed = start_run(given(cloud(), "ball.xyz", shown=again, checkpoint=state))
    assert resumed.step == 2
    assert through(resumed)["result.glb"] == uninterrupted["result.glb"]
    assert again == shown
    branch = start_run(given(cloud(), "ball.xyz", shown=again, initial=state, params={"seed": 9}))
    assert branch.step == 0
    assert again == shown
    assert (
        load_asset(branch.snapshot().data).surface.positions.shape
        == load_asset(shown["source.glb"].data).surface.positions.shape
    )

    tensors = safetensors.torch.load(state)
    del tensors["source.glb"]
    with pytest.raises(CheckpointError, match="does not hold the mesh"):
        start_run(given(cloud(), "ball.xyz", checkpoint=safetensors.torch.save(tensors)))


def test_the_same_file_gives_the_same_mesh_whatever_the_seed() -> None:
    meshes: list[dict[str, ArtifactData]] = [{}, {}]
    for seed, shown in enumerate(meshes):
        start_run(given(cloud(), "ball.xyz", shown=shown, params={"seed": seed}))
    assert meshes[0] == meshes[1]


@pytest.mark.parametrize(
    ("make", "name", "genus", "kind"),
    [(ring_grid, "ring.npz", 1, "grid"), (octahedron, "octahedron.safetensors", 0, "network")],
)
def test_grids_and_networks_become_meshes_too(make: Callable[[], bytes], name: str, genus: int, kind: str) -> None:
    found = read_source(given(make(), name))
    assert found is not None
    assert (found.facts["described_by"], found.facts["genus"]) == (kind, genus)
    assert found.facts["distance"]["mean"] < 0.05
    assert len(load_asset(found.data).surface.triangles) == found.facts["triangles"]


def test_a_mesh_stays_as_it_is() -> None:
    ball = icosphere(1)
    assert read_source(given(build_glb(ball.verts.numpy(), ball.faces.numpy()), "ball.glb")) is None


def test_the_fit_stops_when_the_run_must_and_keeps_to_the_limit() -> None:
    def stop() -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        start_run(given(cloud(), "ball.xyz", on_wait=stop))
    with pytest.raises(AssetTooLargeError, match="the limit is 300"):
        start_run(given(cloud(), "ball.xyz", limits=Limits(max_triangles=300)))


def test_the_command_line_deforms_points_and_writes_the_mesh_beside_the_result(tmp_path: Path) -> None:
    (tmp_path / "ball.xyz").write_bytes(cloud())
    egg = icosphere(2)
    (tmp_path / "egg.glb").write_bytes(build_glb(egg.verts.numpy() * [1, 1.5, 1], egg.faces.numpy()))
    words = [
        "run",
        str(tmp_path / "ball.xyz"),
        "--target",
        str(tmp_path / "egg.glb"),
        "--preset",
        "preview",
        "--steps",
        "3",
    ]
    shell = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "out.glb"), "--orientation", "keep", "--json"])
    assert shell.exit_code == 0, shell.output
    summary = json.loads(shell.stdout)
    assert (summary["source"], summary["targets"]) == (str(tmp_path / "out.source.glb"), [])
    before, after = (load_asset((tmp_path / name).read_bytes()).surface for name in ("out.source.glb", "out.glb"))
    assert np.array_equal(before.triangles, after.triangles)
