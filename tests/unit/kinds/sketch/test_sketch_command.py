"""`meshdeform sketch`, and a run towards what was drawn."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from meshdeform.assets import Limits, load_asset
from meshdeform.kinds.sketch.shapes import shape_glb
from tests.cases import each_case
from tests.drawings import drawing_of
from tests.unit.cli.lines import done, refused


def triangles(file: str) -> int:
    return len(load_asset(Path(file).read_bytes(), file, Limits.unlimited()).surface.triangles)


@pytest.fixture(autouse=True)
def drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drawing of a giraffe in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("drawn.png").write_bytes(drawing_of("giraffe"))


def test_a_drawing_becomes_three_meshes_and_a_picture() -> None:
    said = json.loads(done("sketch drawn.png -o out/made.glb --set neck=0.2 --set variant=2 --json").stdout)
    assert said["guesses"][0]["noun"] == "giraffe"
    assert said["guesses"][0]["sliders"] | {"neck": 0.2, "variant": "2"} == said["guesses"][0]["sliders"]
    assert said["unsure"] == (said["guesses"][0]["probability"] < 0.95)
    for each in said["guesses"]:
        assert triangles(each["file"]) > 100
    with Image.open("out/made.png") as sheet:
        assert sheet.width == 480
    assert "--force" in refused("sketch drawn.png -o out/made.glb")


def test_a_drawing_chooses_among_the_assets_of_a_folder() -> None:
    Path("shapes").mkdir()
    for name in ("chair", "giraffe", "airplane"):
        Path(f"shapes/{name}.glb").write_bytes(shape_glb(name, {}))
    chosen = json.loads(done("sketch drawn.png --among shapes -o best.glb --json").stdout)["chosen"]
    assert chosen[0] == {"name": "giraffe.glb", "file": "best.glb"}
    assert len(chosen) == 3
    assert Path("best.glb").read_bytes() == Path("shapes/giraffe.glb").read_bytes()


def test_a_noun_can_be_named_and_the_drawing_is_never_overwritten() -> None:
    before = Path("drawn.png").read_bytes()
    said = done("sketch drawn.png --noun llama --force")
    assert "llama (" in said.stdout
    assert "unsure" not in said.stderr
    assert Path("drawn.png").read_bytes() == before
    assert Path("drawn.guesses.png").exists()


def test_sliders_alone_make_a_mesh_and_are_listed() -> None:
    done("sketch --noun table --set legs=0.5 -o table.glb")
    assert triangles("table.glb") > 100
    listed = json.loads(done("sketch --noun table --sliders --json").stdout)["sliders"]
    assert {"name": "height", "default": 1.0, "minimum": 0.5, "maximum": 2.0} in listed
    assert "round-table" in done("sketch --noun table --sliders").stdout


@each_case(
    ("line", "said"),
    [
        ("empty.png", "empty"),
        ("drawn.png --noun justice", "no noun"),
        ("drawn.png --noun vase --set neck=9", "neck"),
        ("drawn.png --set neck", "NAME=VALUE"),
        ("drawn.png -o vase.obj", ".glb"),
        ("", "neither"),
        ("--sliders", "no noun"),
    ],
)
def test_what_cannot_be_drawn_is_said(line: str, said: str) -> None:
    Image.new("L", (200, 200), 255).save("empty.png")
    assert said in refused(f"sketch {line}")
    assert not list(Path().glob("*.glb"))
