"""`meshdeform surface-fit` and `unfold`: files in, files out, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from meshdeform.assets import build_glb, load_asset
from meshdeform.cli.app import app
from meshdeform.geometry.shapes import icosphere

_SMALL = ["--base-faces", "100", "--steps", "2", "--width", "8", "--depth", "1", "--octaves", "1", "--level", "0"]


def test_a_fit_is_unfolded_and_nothing_else_is_overwritten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = icosphere(2)
    Path("ball.glb").write_bytes(build_glb(mesh.verts.numpy(), mesh.faces.numpy()))
    run = CliRunner()
    made = run.invoke(app, ["surface-fit", "ball.glb", *_SMALL, "--json", "--checkpoint", "ball.state"])
    assert made.exit_code == 0, made.output
    summary = json.loads(made.stdout)
    assert summary["bytes"] == Path("ball.ndf").stat().st_size
    assert {path.name for path in tmp_path.iterdir()} == {
        "ball.glb", "ball.ndf", "ball.report.json", "ball.preview.png"
    }  # fmt: skip
    unfolded = run.invoke(app, ["unfold", "ball.ndf", "-o", "big.glb", "--level", "2", "--intrinsic", "big.npz"])
    assert unfolded.exit_code == 0, unfolded.output
    surface = load_asset(Path("big.glb").read_bytes()).surface
    assert len(surface.triangles) == 16 * json.loads(Path("ball.report.json").read_bytes())["base"]["faces"]
    assert len(np.load("big.npz")["faces"]) == len(surface.triangles)
    own = run.invoke(
        app,
        ["surface-fit", "ball.glb", *_SMALL[2:], "--base", "ball.glb", "--anchor", "1,0,0:0,1,0", "-o", "own.ndf"],
    )
    assert own.exit_code == 0, own.output
    assert json.loads(Path("own.report.json").read_bytes())["base"]["faces"] == len(mesh.faces)
    meshed = run.invoke(app, ["surface-fit", "ball.glb", *_SMALL, "-o", "mesh.glb", "--json"])
    assert meshed.exit_code == 0, meshed.output
    assert len(load_asset(Path("mesh.glb").read_bytes()).surface.triangles) == 100
    assert json.loads(meshed.stdout)["result"] == "mesh.ndf"
    assert "neither a .ndf nor a .glb" in run.invoke(app, ["surface-fit", "ball.glb", "-o", "mesh.obj"]).output
    for wrong in ("1,0:0,1,0", "1,0,0", "a,0,0:0,1,0"):
        assert "--anchor" in run.invoke(app, ["surface-fit", "ball.glb", "--anchor", wrong]).output
    no_values = ["surface-fit", "ball.glb", *_SMALL, "--scalars", "ball.glb", "-o", "x.ndf"]
    assert "The scalars cannot be read" in run.invoke(app, no_values).output
    assert "exists" in run.invoke(app, ["unfold", "ball.ndf", "-o", "big.glb"]).output
    Path("mine.ndf").write_bytes(b"mine")
    refused = run.invoke(app, ["surface-fit", "ball.glb", *_SMALL, "-o", "mine.ndf"])
    assert refused.exit_code == 3
    assert Path("mine.ndf").read_bytes() == b"mine"
    assert "not a .ndf" in run.invoke(app, ["unfold", "mine.ndf"]).output
    assert "base_faces" in run.invoke(app, ["surface-fit", "ball.glb", "--base-faces", "1"]).output
