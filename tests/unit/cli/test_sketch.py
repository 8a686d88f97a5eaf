"""`meshdeform sketch`, and a run towards what was drawn."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image, ImageDraw

from meshdeform.assets import Limits, load_asset
from meshdeform.kinds.sketch.families import member_glb
from tests.cases import each_case
from tests.drawings import drawing_of
from tests.unit.cli.lines import done, refused


def triangles(file: str) -> int:
    return len(load_asset(Path(file).read_bytes(), file, Limits.unlimited()).surface.triangles)


@pytest.fixture(autouse=True)
def drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drawing of a vase in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("vase.png").write_bytes(drawing_of("vase"))


def test_a_drawing_becomes_three_meshes_and_a_picture() -> None:
    said = json.loads(done("sketch vase.png -o out/made.glb --set lip=0.2 --set handles=two --json").stdout)
    assert said["guesses"][0]["family"] == "vase"
    assert said["guesses"][0]["parameters"] | {"lip": 0.2, "handles": "two"} == said["guesses"][0]["parameters"]
    assert not said["unsure"]
    for each in said["guesses"]:
        assert triangles(each["file"]) > 100
    with Image.open("out/made.png") as sheet:
        assert sheet.width == 480
    assert "--force" in refused("sketch vase.png -o out/made.glb")


def test_a_drawing_chooses_among_the_assets_of_a_folder() -> None:
    Path("shapes").mkdir()
    for name in ("chair", "vase", "airplane"):
        Path(f"shapes/{name}.glb").write_bytes(member_glb(name, {}))
    chosen = json.loads(done("sketch vase.png --among shapes -o best.glb --json").stdout)["chosen"]
    assert chosen[0] == {"name": "vase.glb", "file": "best.glb"}
    assert len(chosen) == 3
    assert Path("best.glb").read_bytes() == Path("shapes/vase.glb").read_bytes()


def test_a_drawing_of_something_else_is_told() -> None:
    page = Image.new("L", (300, 300), 255)
    pen = ImageDraw.Draw(page)
    pen.ellipse((60, 40, 240, 260), outline=0, width=3)  # a face
    for x in (100, 170):
        pen.ellipse((x, 110, x + 30, 130), outline=0, width=3)
    pen.line([(150, 130), (135, 170), (160, 170)], fill=0, width=3)
    pen.arc((100, 170, 200, 220), 20, 160, fill=0, width=3)
    page.save("face.png")
    assert "may be none of chair, table" in done("sketch face.png").stderr
    assert "may be none" not in done("sketch face.png --family vase --force").stderr


def test_the_drawing_is_never_overwritten() -> None:
    before = Path("vase.png").read_bytes()
    assert "vase (" in done("sketch vase.png --force").stdout
    assert Path("vase.png").read_bytes() == before
    assert Path("vase.guesses.png").exists()


def test_parameters_alone_make_a_mesh_and_are_listed() -> None:
    done("sketch --family table --set legs=column -o table.glb")
    assert triangles("table.glb") > 100
    listed = json.loads(done("sketch --parameters --json").stdout)["families"]
    assert listed["table"]["height"] == {"minimum": 0.3, "maximum": 0.9, "default": 0.6}
    assert "leg_thickness" in done("sketch --parameters").stdout


@each_case(
    ("line", "said"),
    [
        ("empty.png", "empty"),
        ("vase.png --family dragon", "no family"),
        ("vase.png --set lip=9", "lip"),
        ("vase.png --set lip", "NAME=VALUE"),
        ("vase.png -o vase.obj", ".glb"),
        ("", "neither"),
        ("--family dragon", "no family"),
    ],
)
def test_what_cannot_be_drawn_is_said(line: str, said: str) -> None:
    Image.new("L", (200, 200), 255).save("empty.png")
    assert said in refused(f"sketch {line}")
    assert not list(Path().glob("*.glb"))
