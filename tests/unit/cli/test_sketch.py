"""`meshdeform sketch`, and a run towards what was drawn."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image, ImageDraw
from typer.testing import CliRunner

from meshdeform.assets import Limits, load_asset
from meshdeform.cli.app import app
from meshdeform.kinds.sketch.families import member_glb
from tests.cases import each_case
from tests.drawings import drawing_of

run = CliRunner().invoke


@pytest.fixture(autouse=True)
def drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drawing of a vase in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("vase.png").write_bytes(drawing_of("vase"))


def test_a_drawing_becomes_three_meshes_and_a_picture() -> None:
    found = run(app, ["sketch", "vase.png", "-o", "out/made.glb", "--set", "lip=0.2", "--set", "handles=two", "--json"])
    assert found.exit_code == 0, found.output
    said = json.loads(found.stdout)
    assert said["guesses"][0]["family"] == "vase"
    assert said["guesses"][0]["parameters"] | {"lip": 0.2, "handles": "two"} == said["guesses"][0]["parameters"]
    assert not said["unsure"]
    for each in said["guesses"]:
        assert (
            len(load_asset(Path(each["file"]).read_bytes(), each["file"], Limits.unlimited()).surface.triangles) > 100
        )
    with Image.open("out/made.png") as sheet:
        assert sheet.width == 480
    again = run(app, ["sketch", "vase.png", "-o", "out/made.glb"])
    assert again.exit_code == 3
    assert "--force" in again.stderr


def test_a_drawing_chooses_among_the_assets_of_a_folder() -> None:
    Path("shapes").mkdir()
    for name in ("chair", "vase", "airplane"):
        Path(f"shapes/{name}.glb").write_bytes(member_glb(name, {}))
    found = run(app, ["sketch", "vase.png", "--among", "shapes", "-o", "best.glb", "--json"])
    assert found.exit_code == 0, found.output
    chosen = json.loads(found.stdout)["chosen"]
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
    found = run(app, ["sketch", "face.png"])
    assert found.exit_code == 0, found.output
    assert "may be none of chair, table" in found.stderr
    assert "unsure" not in run(app, ["sketch", "face.png", "--family", "vase", "--force"]).stderr


def test_the_drawing_is_never_overwritten() -> None:
    before = Path("vase.png").read_bytes()
    found = run(app, ["sketch", "vase.png", "--force"])
    assert found.exit_code == 0, found.output
    assert Path("vase.png").read_bytes() == before
    assert Path("vase.guesses.png").exists()
    assert "vase (" in found.stdout


def test_parameters_alone_make_a_mesh_and_are_listed() -> None:
    assert run(app, ["sketch", "--family", "table", "--set", "legs=column", "-o", "table.glb"]).exit_code == 0
    nodes = load_asset(Path("table.glb").read_bytes(), "table.glb", Limits.unlimited()).surface
    assert len(nodes.triangles) > 100
    listed = json.loads(run(app, ["sketch", "--parameters", "--json"]).stdout)["families"]
    assert listed["table"]["height"] == {"minimum": 0.3, "maximum": 0.9, "default": 0.6}
    assert "leg_thickness" in run(app, ["sketch", "--parameters"]).stdout


@each_case(
    ("arguments", "code", "said"),
    [
        (["empty.png"], 3, "empty"),
        (["vase.png", "--family", "dragon"], 3, "no family"),
        (["vase.png", "--set", "lip=9"], 3, "lip"),
        (["vase.png", "--set", "lip"], 2, "NAME=VALUE"),
        (["vase.png", "-o", "vase.obj"], 2, ".glb"),
        ([], 3, "neither"),
        (["--family", "dragon"], 3, "no family"),
    ],
)
def test_what_cannot_be_drawn_is_said(arguments: list[str], code: int, said: str) -> None:
    Image.new("L", (200, 200), 255).save("empty.png")
    found = run(app, ["sketch", *arguments])
    assert found.exit_code == code, found.output
    assert said in found.stderr
    assert not list(Path().glob("*.glb"))
