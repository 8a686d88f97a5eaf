"""`batch --as-morph-targets`: the results of one asset as named morph targets of one file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from meshdeform.assets import build_glb, load_asset
from meshdeform.cli.app import app
from meshdeform.cli.batches import runners
from meshdeform.cli.batches.rows import Row
from meshdeform.cli.batches.runners import RowOutcome
from meshdeform.cli.output import ProgressView
from meshdeform.geometry.shapes import icosphere
from tests.unit.assets.builders import unpack
from tests.unit.assets.test_replace import accessor

HEIGHTS = {"a mushroom": 2.0, "a vase": 3.0, "a rocket": None}


class FakeRunner:
    """Stretches an asset to the height of its prompt, or fails."""

    def __init__(self, folder: Path, _share: object) -> None:
        self._folder = folder

    def do(self, row: Row, _progress: ProgressView) -> RowOutcome:
        height = HEIGHTS[row.request.prompt]
        if height is None:
            return RowOutcome("failed", 1.0, error={"code": "numerical_error", "detail": "", "advice": ""})
        source = load_asset(row.asset.read_bytes())
        path = row.path(self._folder, "result.glb")
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(source.replace(source.surface.positions * [1, height, 1]))
        return RowOutcome("succeeded", 1.0)

    def close(self) -> None:
        """Close nothing."""


def test_the_results_of_an_asset_are_the_targets_of_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runners, "LocalRunner", FakeRunner)
    ball = icosphere(1).verts.numpy()
    (tmp_path / "ball.glb").write_bytes(build_glb(ball, icosphere(1).faces.numpy()))
    prompts = [word for prompt in HEIGHTS for word in ("--prompt", prompt)]
    command = ["batch", str(tmp_path / "ball.glb"), *prompts, "-o", str(tmp_path / "out"), "--as-morph-targets"]
    done = CliRunner().invoke(app, [*command, "--json"])
    assert done.exit_code == 8, done.output  # one row failed
    made = json.loads(done.stdout.splitlines()[-1])["files"]["ball.targets.glb"]
    root, binary, _ = unpack(Path(made).read_bytes())
    (mesh,) = root["meshes"]
    assert mesh["extras"]["targetNames"] == ["ball-a-mushroom", "ball-a-vase"]
    assert mesh["weights"] == [0.0, 0.0]
    assert "animations" not in root
    for target, height in zip(mesh["primitives"][0]["targets"], (2.0, 3.0), strict=True):
        moved = accessor(root, binary, target["POSITION"])
        np.testing.assert_allclose(moved, ball * [0, height - 1, 0], atol=1e-6)
