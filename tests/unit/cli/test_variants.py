"""`meshdeform variants`: a run for each seed, a file for each strength, and one sheet."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from meshdeform.assets import build_glb
from meshdeform.cli.app import app
from meshdeform.geometry.shapes import icosphere


def test_every_seed_at_every_strength_and_one_sheet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = icosphere(1)
    for name, height in (("ball.glb", 1.0), ("egg.glb", 2.0)):
        Path(name).write_bytes(build_glb(mesh.verts.numpy() * [1, height, 1], mesh.faces.numpy()))
    command = ["variants", "ball.glb", "--target", "egg.glb", "--set", "steps=1", "-o", "out"]
    refused = CliRunner().invoke(app, [*command, "--strengths", "0.5,2"])
    assert (refused.exit_code, Path("out").exists()) == (2, False)
    assert CliRunner().invoke(app, [*command, "--seeds", "one"]).exit_code == 2
    assert CliRunner().invoke(app, ["variants", "ball.glb", "--target", ".", "-o", "out"]).exit_code == 2
    done = CliRunner().invoke(app, [*command, "--seeds", "3,4", "--strengths", "0.5,1,1.5"])
    assert done.exit_code == 0, done.output
    for seed in (3, 4):
        names = {path.name for path in Path(f"out/seed{seed}").iterdir()}
        assert names >= {"result.glb", "strength50.glb", "strength100.glb", "strength150.glb"}
        assert Path(f"out/seed{seed}/strength100.glb").read_bytes() == Path(f"out/seed{seed}/result.glb").read_bytes()
    with Image.open("out/variants.png") as sheet:
        assert sheet.size == (3 * 224, 2 * (224 + 24))
    again = CliRunner().invoke(app, command)
    assert again.exit_code == 3
    assert "out is not empty" in again.output
