"""A target that a text-to-3D model makes: shown, kept, and fitted from the command line."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from meshdeform.assets import build_glb, load_asset
from meshdeform.cli.app import app
from meshdeform.errors import ModelError
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import shap_e
from meshdeform.requests.document import JobRequest
from meshdeform.requests.stages import GeneratedTarget
from meshdeform.runs import generated_target
from meshdeform.runs.base import RunInput
from tests.tiny_shap_e import build_tiny_shap_e


@pytest.fixture(autouse=True)
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shap_e, "GRID", 16)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))


def test_it_is_kept_by_all_that_decides_it(tiny_shap_e: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded, told = [], []
    real = generated_target.load_generator
    monkeypatch.setattr(generated_target, "load_generator", lambda *a, **k: loaded.append(a) or real(*a, **k))
    given = RunInput(
        JobRequest(prompt="a vase"),
        {},
        on_phase=lambda name: told.append(name),
        on_artifact=lambda name, artifact: told.append((name, artifact.data)),
    )

    def made(seed: int = 0, **changes: object) -> bytes:
        wanted = {"prompt": "a shark", "model": str(tiny_shap_e), "steps": 2, **changes}
        return generated_target.generated_target(GeneratedTarget.model_validate(wanted), "target.glb", seed, given)

    first = made()
    assert told == ["target", ("target.glb", first)]
    assert made() == first
    assert len(loaded) == 1
    others = [made(seed=1), made(prompt="a chair"), made(guidance_scale=2.0)]
    assert len(loaded) == 4
    assert len({first, *others}) == 4
    assert load_asset(first).surface.normals is not None
    # A model whose files have changed is another one.
    os.utime(tiny_shap_e / "model_index.json", ns=(1, 1))
    made()
    assert len(loaded) == 5
    # Only the newest are kept; a folder that cannot be written keeps none and stops nothing.
    monkeypatch.setattr(generated_target, "KEPT", 2)
    made(seed=2)
    assert len(list((tmp_path / "caches/meshdeform/targets").iterdir())) == 2
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert made(seed=2) == made(seed=2)


def test_an_empty_one_fails_and_names_no_folder(tmp_path: Path) -> None:
    folder = build_tiny_shap_e(tmp_path / "secret" / "empty-model", empty=True)
    wanted = GeneratedTarget(prompt="a shark", model=str(folder), steps=1)
    with pytest.raises(ModelError, match="The mesh that empty-model made is empty") as caught:
        generated_target.generated_target(wanted, "target.glb", 0, RunInput(JobRequest(), {}))
    assert "secret" not in str(caught.value)


def test_the_command_line_fits_it_and_writes_it_beside_the_result(
    tiny_shap_e: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    sphere = icosphere(2)
    Path("a.glb").write_bytes(build_glb(sphere.verts.numpy(), sphere.faces.numpy()))
    run = ["run", "a.glb", "--preset", "preview", "--steps", "20", "-o", "b.glb"]
    wanted = ["--target-prompt", "a shark", "--target-model", str(tiny_shap_e)]
    done = CliRunner().invoke(app, [*run, *wanted, "--json"])
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    assert summary["targets"] == ["b.target.glb"]
    assert summary["fit"]["within"] > 0.9
    target, result = (load_asset(Path(name).read_bytes()).surface.positions for name in ("b.target.glb", "b.glb"))
    for extent in (target.max(0) - target.min(0), result.max(0) - result.min(0)):
        assert extent[1] > extent[2] > extent[0]
    alone = CliRunner().invoke(app, [*run, *wanted[:2]])
    assert alone.exit_code == 2
    assert "--target-model" in alone.output
    both = CliRunner().invoke(app, [*run, *wanted, "--stage", "a pear"])
    assert both.exit_code == 2
    nowhere = CliRunner().invoke(app, [*run, "--stage", "nowhere.glb"])
    assert "there is no file nowhere.glb" in nowhere.output
