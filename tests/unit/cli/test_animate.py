"""`meshdeform run --animate` and `meshdeform animate`."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from meshdeform.assets import build_glb
from meshdeform.cli.app import app
from meshdeform.geometry.shapes import icosphere
from meshdeform.rendering import animation


@pytest.fixture
def ball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("morph_animation", "turntable_animation"):
        small = functools.partial(getattr(animation, name), size=32, frames=4)
        monkeypatch.setattr(animation, name, small)
    monkeypatch.chdir(tmp_path)
    mesh = icosphere(1)
    Path("ball.glb").write_bytes(build_glb(mesh.verts.numpy(), mesh.faces.numpy()))
    Path("egg.glb").write_bytes(build_glb(mesh.verts.numpy() * [1, 1.5, 1], mesh.faces.numpy()))
    return Path("ball.glb")


def test_a_run_and_the_command_write_an_animation(ball: Path) -> None:
    options = ["--target", "egg.glb", "--steps", "1", "--json", "-o", "out.glb", "--animate", "way/out.webp"]
    ran = CliRunner().invoke(app, ["run", str(ball), *options])
    assert ran.exit_code == 0, ran.output
    assert json.loads(ran.stdout)["animation"] == "way/out.webp"
    with Image.open("way/out.webp") as picture:
        assert (picture.format, picture.size) == ("WEBP", (32, 32))
    for files, frames in (([str(ball), "egg.glb"], {6}), ([str(ball)], {1, 2, 3, 4})):  # equal frames become one
        result = CliRunner().invoke(app, ["animate", *files, "-o", "a.gif", "--force"])
        assert result.exit_code == 0, result.output
        with Image.open("a.gif") as picture:
            assert picture.format == "GIF"
            assert getattr(picture, "n_frames", 1) in frames


def test_a_subdivided_result_is_drawn_from_the_subdivided_source(ball: Path) -> None:
    options = ["--target", "egg.glb", "--steps", "1", "--subdivide", "-q", "-o", "out.glb", "--animate", "out.gif"]
    ran = CliRunner().invoke(app, ["run", str(ball), *options])
    assert ran.exit_code == 0, ran.output
    assert Path("out.gif").exists()


def test_a_picture_that_is_there_is_only_replaced_with_force(ball: Path) -> None:
    Path("a.gif").write_text("mine")
    refused = CliRunner().invoke(app, ["animate", str(ball), "-o", "a.gif"])
    assert (refused.exit_code, Path("a.gif").read_text()) == (3, "mine")
    assert "--force" in refused.output
    assert CliRunner().invoke(app, ["animate", str(ball), "-o", "a.gif", "--force"]).exit_code == 0
    assert Path("a.gif").read_bytes()[:3] == b"GIF"


def test_a_wrong_suffix_and_another_asset_are_refused(ball: Path) -> None:
    result = CliRunner().invoke(app, ["run", str(ball), "a vase", "--animate", "out.mp4"])
    assert result.exit_code == 2
    assert "out.mp4 ends in neither .webp nor .gif" in result.output
    mesh = icosphere(2)
    Path("other.glb").write_bytes(build_glb(mesh.verts.numpy(), mesh.faces.numpy()))
    result = CliRunner().invoke(app, ["animate", str(ball), "other.glb"])
    assert result.exit_code == 3
    assert not Path("animation.webp").exists()
