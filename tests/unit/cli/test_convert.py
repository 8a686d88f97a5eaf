"""`meshdeform convert`: assets in other formats, from files alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from meshdeform.assets import build_glb, load_asset
from meshdeform.cli.app import app
from meshdeform.geometry.shapes import icosphere

BALL = icosphere(1)


def convert(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["convert", *map(str, arguments)])


@pytest.fixture
def ball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    verts, faces = BALL.verts.numpy() * [1, 2, 1], BALL.faces.numpy()
    Path("ball.glb").write_bytes(build_glb(verts, faces, material="clay", name="ball"))
    Path("shell.glb").write_bytes(build_glb(verts, faces[1:]))
    return Path("ball.glb")


def test_an_stl_is_in_the_chosen_frame_and_reads_as_a_glb_again(ball: Path) -> None:
    import trimesh

    done = convert(ball, "-o", "for print/ball.stl", "--up", "z", "--unit", "mm")
    assert (done.exit_code, done.stdout) == (0, "for print/ball.stl\n"), done.output
    mesh = trimesh.load_mesh("for print/ball.stl")
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.extents, np.ptp(BALL.verts.numpy(), axis=0)[[0, 2, 1]] * [1e3, 1e3, 2e3], rtol=1e-6)
    assert convert(ball, "-o", "plain.stl").exit_code == 0
    again = convert("plain.stl", "-o", "again.glb", "--json")
    assert json.loads(again.stdout)["triangles"] == 80
    surface, read = (load_asset(path.read_bytes()).surface for path in (ball, Path("again.glb")))
    np.testing.assert_array_equal(
        read.positions[read.triangles], surface.positions[surface.triangles].astype(np.float32)
    )
    assert convert(ball, "-o", "same.glb").exit_code == 0
    assert Path("same.glb").read_bytes() == ball.read_bytes()


@pytest.mark.parametrize(("source", "closed"), [("ball.glb", True), ("shell.glb", False)])
def test_whether_a_surface_is_closed_is_said(ball: Path, source: str, closed: bool) -> None:
    facts = json.loads(convert(source, "-o", "x.stl", "--json").stdout)
    assert facts["closed"] is closed


def test_what_cannot_be_done_is_said(ball: Path) -> None:
    def refused(*arguments: object) -> str:
        done = convert(*arguments)
        assert done.exit_code in (2, 3), done.output
        return " ".join(done.output.split())

    assert "ends in none of .glb, .stl" in refused(ball, "-o", "ball.fbx")
    assert "Blender" in refused(ball, "-o", "ball.obj.zip")
    Path("ball.stl").write_text("mine")
    assert "ball.stl exists" in refused(ball, "-o", "ball.stl")
    assert Path("ball.stl").read_text() == "mine"
    assert convert(ball, "-o", "ball.stl", "--force").exit_code == 0
    assert "is an input" in refused("ball.stl", "-o", "./ball.stl", "--force")
    Path("broken.glb").write_bytes(b"glTF")
    refused("broken.glb", "-o", "x.stl")
    assert not Path("x.stl").exists()
