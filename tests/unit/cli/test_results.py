"""`meshdeform run --animate` and `meshdeform animate`."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from meshdeform.assets import build_glb, load_asset
from meshdeform.cli.app import app
from meshdeform.geometry.shapes import icosphere
from meshdeform.rendering import studio


@pytest.fixture
def ball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("morph_animation", "turntable_animation"):
        small = functools.partial(getattr(studio, name), size=32, frames=4)
        monkeypatch.setattr(studio, name, small)
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


# `meshdeform apply`: another strength of a result, and its morph, from files alone.


BALL = icosphere(1)


def glb(*scale: float) -> bytes:
    return build_glb(BALL.verts.numpy() * scale, BALL.faces.numpy())


def apply(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["apply", *map(str, arguments)])


@pytest.fixture
def ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The result of a run, with its source and its report beside it."""
    monkeypatch.chdir(tmp_path)
    Path("ball.glb").write_bytes(glb(1, 1, 1))
    Path("egg.glb").write_bytes(glb(1, 2, 1))
    done = CliRunner().invoke(app, ["run", "ball.glb", "--target", "egg.glb", "--steps", "2", "-o", "out.glb"])
    assert done.exit_code == 0, done.output
    return Path("out.glb")


def height(path: str) -> float:
    return float(np.ptp(load_asset(Path(path).read_bytes()).surface.positions[:, 1]))


def test_the_report_names_the_source_of_a_result(ran: Path) -> None:
    for strength, name in ((0, "out-0.glb"), (0.6, "out-60.glb"), (1, "out-100.glb"), (1.5, "out-150.glb")):
        found = apply(ran, "--strength", strength)
        assert (found.exit_code, found.stdout) == (0, f"{name}\n")
    changes = [abs(height(f"out-{percent}.glb") - height("ball.glb")) for percent in (0, 60, 100, 150)]
    assert changes == sorted(changes)
    assert changes[0] == 0 < changes[1]
    assert Path("out-100.glb").read_bytes() == ran.read_bytes()


def test_other_files_are_deformed_alike_by_a_result_or_its_map(ran: Path) -> None:
    Path("lod.glb").write_bytes(build_glb(icosphere(0).verts.numpy(), icosphere(0).faces.numpy()))
    Path("hat.glb").write_bytes(glb(0.5, 0.5, 0.5))
    assert apply(ran, "--strength", 1.5, "-o", "edit.safetensors").stdout == "edit.safetensors\n"
    grown = height("out.glb") / height("ball.glb")
    assert apply("lod.glb", "hat.glb", "--map", ran, "-o", "alike").stdout == "alike/lod.glb\nalike/hat.glb\n"
    assert height("alike/lod.glb") / height("lod.glb") == pytest.approx(grown, abs=0.02)
    assert apply("lod.glb", "--map", "edit.safetensors").stdout == "lod-edited.glb\n"
    more = 1 + 1.5 * (grown - 1)
    assert height("lod-edited.glb") / height("lod.glb") == pytest.approx(more, abs=0.03)
    for arguments, said in (
        (["lod.glb", "hat.glb"], "name one result"),
        (["lod.glb", "--map", ran, "--morph"], "a map has no morph"),
        (["lod.glb", "hat.glb", "--map", ran, "-o", "one.glb"], "name a folder"),
        (["lod.glb", "lod.glb", "--map", ran, "-o", "two"], "same name"),
        (["lod.glb", "--map", "edit.safetensors", "--strength", 0.5], "a map has one strength"),
        (["lod.glb", "--map", "edit.safetensors"], "lod-edited.glb exists"),
    ):
        found = apply(*arguments)
        assert found.exit_code in (2, 3), arguments
        assert said in " ".join(found.output.replace("│", " ").split()), arguments


def test_what_is_missing_is_said(ran: Path) -> None:
    def refused(*arguments: object) -> str:
        found = apply(*arguments)
        assert found.exit_code in (2, 3)
        return " ".join(found.output.split())

    assert "Beside egg.glb there is no report" in refused("egg.glb", "--strength", 0.5)
    assert "was not made from" in refused(ran, "--source", _other(), "--strength", 0.5)
    assert "out.glb is an input" in refused(ran, "-o", "out.glb")
    assert "egg.glb exists" in refused(ran, "-o", "egg.glb")
    assert "frames: Input should be" in refused(ran, "--frames", "0")
    assert "less than or equal to 1.5" in refused(ran, "--strength", 1.6)
    Path("ball.glb").write_bytes(glb(1, 1, 2))
    assert "or has changed" in refused(ran, "--strength", 0.5)


def _other() -> Path:
    mesh = icosphere(2)
    Path("other.glb").write_bytes(build_glb(mesh.verts.numpy(), mesh.faces.numpy()))
    return Path("other.glb")


# `meshdeform convert`: assets in other formats, from files alone.


def convert(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["convert", *map(str, arguments)])


@pytest.fixture
def written_ball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    verts, faces = BALL.verts.numpy() * [1, 2, 1], BALL.faces.numpy()
    Path("written_ball.glb").write_bytes(build_glb(verts, faces, material="clay", name="written_ball"))
    Path("shell.glb").write_bytes(build_glb(verts, faces[1:]))
    return Path("written_ball.glb")


def test_an_stl_is_in_the_chosen_frame_and_reads_as_a_glb_again(written_ball: Path) -> None:
    import trimesh

    done = convert(written_ball, "-o", "for print/written_ball.stl", "--up", "z", "--unit", "mm")
    assert (done.exit_code, done.stdout) == (0, "for print/written_ball.stl\n"), done.output
    mesh = trimesh.load_mesh("for print/written_ball.stl")
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.extents, np.ptp(BALL.verts.numpy(), axis=0)[[0, 2, 1]] * [1e3, 1e3, 2e3], rtol=1e-6)
    assert convert(written_ball, "-o", "plain.stl").exit_code == 0
    again = convert("plain.stl", "-o", "again.glb", "--json")
    assert json.loads(again.stdout)["triangles"] == 80
    surface, read = (load_asset(path.read_bytes()).surface for path in (written_ball, Path("again.glb")))
    np.testing.assert_array_equal(
        read.positions[read.triangles], surface.positions[surface.triangles].astype(np.float32)
    )
    assert convert(written_ball, "-o", "same.glb").exit_code == 0
    assert Path("same.glb").read_bytes() == written_ball.read_bytes()


@pytest.mark.parametrize(("source", "closed"), [("written_ball.glb", True), ("shell.glb", False)])
def test_whether_a_surface_is_closed_is_said(written_ball: Path, source: str, closed: bool) -> None:
    facts = json.loads(convert(source, "-o", "x.stl", "--json").stdout)
    assert facts["closed"] is closed


def test_what_cannot_be_done_is_said(written_ball: Path) -> None:
    def refused(*arguments: object) -> str:
        done = convert(*arguments)
        assert done.exit_code in (2, 3), done.output
        return " ".join(done.output.split())

    assert "ends in none of .glb, .stl" in refused(written_ball, "-o", "written_ball.fbx")
    assert "Blender" in refused(written_ball, "-o", "written_ball.obj.zip")
    Path("written_ball.stl").write_text("mine")
    assert "written_ball.stl exists" in refused(written_ball, "-o", "written_ball.stl")
    assert Path("written_ball.stl").read_text() == "mine"
    assert convert(written_ball, "-o", "written_ball.stl", "--force").exit_code == 0
    assert "is an input" in refused("written_ball.stl", "-o", "./written_ball.stl", "--force")
    Path("broken.glb").write_bytes(b"glTF")
    refused("broken.glb", "-o", "x.stl")
    assert not Path("x.stl").exists()
