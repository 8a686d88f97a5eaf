"""`meshdeform convert`: assets in other formats, from files alone."""

from __future__ import annotations

import json
import zipfile
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


def test_the_ending_chooses_the_format(ball: Path) -> None:
    import trimesh

    found = convert(ball, "-o", "for print/ball.stl", "--up", "z", "--unit", "mm")
    assert (found.exit_code, found.stdout) == (0, "for print/ball.stl\n"), found.output
    assert found.stderr == "80 triangles in millimetres, +Z up; the surface is closed.\n"
    mesh = trimesh.load_mesh("for print/ball.stl")
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.extents, np.ptp(BALL.verts.numpy(), axis=0)[[0, 2, 1]] * [1e3, 1e3, 2e3], rtol=1e-6)

    found = convert(ball, "-o", "ball.obj")
    assert (found.exit_code, found.stdout) == (0, "ball.obj\nball.mtl\n"), found.output
    found = convert(ball, "-o", "ball.obj.zip", "--json")
    facts = {"triangles": 80, "closed": True, "open_edges": 0, "tangled_edges": 0, "left_out": {}}
    assert json.loads(found.stdout) == {"files": ["ball.obj.zip"], **facts}
    with zipfile.ZipFile("ball.obj.zip") as package:
        assert package.read("ball.obj") == Path("ball.obj").read_bytes()
        assert package.read("ball.mtl") == Path("ball.mtl").read_bytes()
    # What it writes can be converted again.
    assert convert("ball.obj.zip", "-o", "again.stl").exit_code == 0
    surface = load_asset(ball.read_bytes()).surface
    again = trimesh.load_mesh("again.stl", process=False).triangles
    np.testing.assert_array_equal(again, surface.positions[surface.triangles].astype(np.float32))


def test_an_open_surface_is_said(ball: Path) -> None:
    found = convert("shell.glb", "-o", "shell.stl")
    assert (found.exit_code, found.stderr) == (
        0,
        "79 triangles in metres, +Y up; the surface is not closed: 3 open edges, 0 tangled edges.\n",
    )
    assert b"open edges 3, tangled 0" in Path("shell.stl").read_bytes()[:80]


def test_what_cannot_be_done_is_said(ball: Path) -> None:
    def refused(*arguments: object) -> str:
        found = convert(*arguments)
        assert found.exit_code in (2, 3), found.output
        return " ".join(found.output.split())

    assert "ends in none of .obj, .zip, .stl" in refused(ball, "-o", "ball.fbx")
    Path("ball.mtl").write_text("mine")
    assert "ball.mtl exists" in refused(ball, "-o", "ball.obj")
    assert not Path("ball.obj").exists()
    assert convert(ball, "-o", "ball.obj", "--force").exit_code == 0
    assert Path("ball.mtl").read_text() != "mine"
    assert "is the input" in refused("ball.obj", "-o", "./ball.obj", "--force")
    Path("broken.glb").write_bytes(b"glTF")
    refused("broken.glb", "-o", "x.stl")
    assert not Path("x.stl").exists()
