"""`meshdeform animate`, `apply` and `convert`, on the result of a run."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from meshdeform.assets import build_glb, load_asset
from meshdeform.geometry.shapes import icosphere
from meshdeform.rendering import studio
from tests.cases import each_case
from tests.toolchain.assets import ASSETS
from tests.unit.cli.lines import done, refused

BALL = icosphere(1)


@pytest.fixture(autouse=True)
def ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball, an egg, something else, and the ball run to the egg with an animation, in the current folder."""
    for name in ("morph_animation", "turntable_animation"):
        monkeypatch.setattr(studio, name, functools.partial(getattr(studio, name), size=32, frames=4))
    monkeypatch.chdir(tmp_path)
    write("ball.glb", 1, 1, 1)
    write("egg.glb", 1, 2, 1)
    write("other.glb", 1, 1, 1, level=2)
    made = done("run ball.glb --target egg.glb --steps 2 --json -o out.glb --animate way/out.webp")
    assert json.loads(made.stdout)["animation"] == "way/out.webp"


def write(name: str, *scale: float, level: int = 1) -> None:
    mesh = icosphere(level)
    Path(name).write_bytes(build_glb(mesh.verts * scale, mesh.faces, name="mesh", material="clay"))


def height(path: str) -> float:
    return float(np.ptp(load_asset(Path(path).read_bytes()).surface.positions[:, 1]))


def test_a_run_and_the_command_write_an_animation() -> None:
    with Image.open("way/out.webp") as picture:
        assert (picture.format, picture.size) == ("WEBP", (32, 32))
    for files, frames in ((["ball.glb", "egg.glb"], {6}), (["ball.glb"], {1, 2, 3, 4})):  # equal frames become one
        done("animate -o a.gif --force", *files)
        with Image.open("a.gif") as picture:
            assert picture.format == "GIF"
            assert getattr(picture, "n_frames", 1) in frames
    done("run ball.glb --target egg.glb --steps 1 --subdivide -o fine.glb --animate fine.gif")
    assert Path("fine.gif").exists()


def test_the_report_names_the_source_of_a_result() -> None:
    for strength, name in ((0, "out-0.glb"), (0.6, "out-60.glb"), (1, "out-100.glb"), (1.5, "out-150.glb")):
        assert done(f"apply out.glb --strength {strength}").stdout == f"{name}\n"
    changes = [abs(height(f"out-{percent}.glb") - height("ball.glb")) for percent in (0, 60, 100, 150)]
    assert changes == sorted(changes)
    assert changes[0] == 0 < changes[1]
    assert Path("out-100.glb").read_bytes() == Path("out.glb").read_bytes()


def test_other_files_are_deformed_alike_by_a_result_or_its_map() -> None:
    write("lod.glb", 1, 1, 1, level=0)
    write("hat.glb", 0.5, 0.5, 0.5)
    assert done("apply out.glb --strength 1.5 -o edit.safetensors").stdout == "edit.safetensors\n"
    grown = height("out.glb") / height("ball.glb")
    assert done("apply lod.glb hat.glb --map out.glb -o alike").stdout == "alike/lod.glb\nalike/hat.glb\n"
    assert height("alike/lod.glb") / height("lod.glb") == pytest.approx(grown, abs=0.02)
    assert done("apply lod.glb --map edit.safetensors").stdout == "lod-edited.glb\n"
    more = 1 + 1.5 * (grown - 1)
    assert height("lod-edited.glb") / height("lod.glb") == pytest.approx(more, abs=0.03)


def test_an_stl_is_in_the_chosen_frame_and_reads_as_a_glb_again() -> None:
    import trimesh

    assert done("convert egg.glb --up z --unit mm -o", "for print/egg.stl").stdout == "for print/egg.stl\n"
    mesh = trimesh.load_mesh("for print/egg.stl")
    np.testing.assert_allclose(mesh.extents, np.ptp(BALL.verts, axis=0)[[0, 2, 1]] * [1e3, 1e3, 2e3], rtol=1e-6)
    assert json.loads(done("convert egg.glb -o plain.stl --json").stdout)["closed"] is True
    assert json.loads(done("convert plain.stl -o again.glb --json").stdout)["triangles"] == 80
    surface, read = (load_asset(Path(path).read_bytes()).surface for path in ("egg.glb", "again.glb"))
    np.testing.assert_array_equal(
        read.positions[read.triangles], surface.positions[surface.triangles].astype(np.float32)
    )
    done("convert egg.glb -o same.glb")
    assert Path("same.glb").read_bytes() == Path("egg.glb").read_bytes()
    Path("shell.glb").write_bytes(build_glb(BALL.verts, BALL.faces[1:]))
    assert json.loads(done("convert shell.glb -o shell.stl --json").stdout)["closed"] is False


def test_an_obj_comes_with_its_files_beside_it_and_a_pose_has_a_name_of_its_own() -> None:
    Path("rigged.glb").write_bytes(ASSETS["rigged"]())
    report = json.loads(done("convert rigged.glb new/tube.obj --json").stdout)
    assert report["files"] == ["new/tube.obj", "new/tube.mtl", "new/tube_textures/image0.png"]
    assert report["warnings"] == ["Without animations.", "Without skins."]
    assert all(Path(name).stat().st_size for name in report["files"])
    Path("new/tube.obj").unlink()
    assert "tube.mtl exists" in refused("convert rigged.glb new/tube.obj")
    assert done("convert rigged.glb --pose swing@0.5").stdout == "rigged-posed.glb\n"
    assert not load_asset(Path("rigged-posed.glb").read_bytes()).rig()


@each_case(
    ("line", "said"),
    [
        ("run ball.glb vase --animate out.mp4", "neither .webp nor .gif"),
        ("animate ball.glb other.glb", ""),
        ("animate ball.glb -o mine.gif", "--force"),
        ("apply egg.glb --strength 0.5", "there is no report"),
        ("apply out.glb --source other.glb --strength 0.5", "was not made from"),
        ("apply out.glb -o out.glb", "out.glb is an input"),
        ("apply out.glb -o egg.glb", "egg.glb exists"),
        ("apply out.glb --frames 0", "frames: "),
        ("apply out.glb --strength 1.6", "1.5"),
        ("apply stale.glb --strength 0.5", "or has changed"),
        ("apply ball.glb egg.glb", "name one result"),
        ("apply ball.glb --map out.glb --morph", "a map has no morph"),
        ("apply ball.glb egg.glb --map out.glb -o one.glb", "name a folder"),
        ("apply ball.glb ball.glb --map out.glb -o two", "same name"),
        ("apply ball.glb --map edit.safetensors --strength 0.5", "a map has one strength"),
        ("apply ball.glb --map edit.safetensors", "ball-edited.glb exists"),
        ("convert ball.glb -o ball.fbx", "Blender"),
        ("convert ball.glb one.obj -o two.obj", "name one file"),
        ("convert ball.glb", "name one file"),
        ("convert ball.glb new.usdz --up z", "one axis"),
        ("convert ball.glb --pose 0@1", "no animations"),
        ("convert ball.glb -o mine.stl", "mine.stl exists"),
        ("convert ball.glb -o ./ball.glb --force", "is an input"),
        ("convert broken.glb -o new.stl", ""),
    ],
)
def test_what_cannot_be_done_is_said_and_nothing_is_overwritten(line: str, said: str) -> None:
    done("apply out.glb -o edit.safetensors --force")
    report = json.loads(Path("out.report.json").read_text())
    Path("stale.glb").write_bytes(Path("out.glb").read_bytes())
    Path("stale.report.json").write_text(json.dumps(report).replace(report["input"]["sha256"], "0" * 64))
    for mine in ("mine.gif", "mine.stl", "ball-edited.glb"):
        Path(mine).write_text("mine")
    Path("broken.glb").write_bytes(b"glTF")
    before = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
    assert said in refused(line)
    assert {path: path.read_bytes() for path in Path().iterdir() if path.is_file()} == before


def test_what_is_there_is_replaced_with_force() -> None:
    for command, name, begins in (("animate", "mine.gif", b"GIF"), ("convert", "mine.stl", b"")):
        Path(name).write_text("mine")
        done(f"{command} ball.glb -o {name} --force")
        assert Path(name).read_bytes() != b"mine"
        assert Path(name).read_bytes().startswith(begins)
