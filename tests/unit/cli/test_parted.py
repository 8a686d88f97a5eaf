"""`meshdeform inspect --parts-glb` writes the parts that it lists, and loses no file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.assets.build import Primitive, build_glb
from meshdeform.assets.parted import parts_of
from tests.cases import each_case
from tests.unit.assets.builders import unpack
from tests.unit.cli.lines import done, refused
from training.shapes import box


@pytest.fixture
def chair(tmp_path: Path) -> Path:
    """A chair whose parts are nodes with names."""
    solid = box(2)
    verts, faces = solid.verts, solid.faces
    places = {"Seat": ([1, 0.1, 1], [0, 0.5, 0]), "Back": ([1, 0.9, 0.1], [0, 1.01, -0.45])}
    legs = {f"Leg{x}{z}": ([0.1, 0.5, 0.1], [0.4 * x, 0.19, 0.4 * z]) for x in (-1, 1) for z in (-1, 1)}
    pieces = [
        Primitive(verts * size + np.array(place, float), faces, name=name)
        for name, (size, place) in {**places, **legs}.items()
    ]
    path = tmp_path / "chair.glb"
    path.write_bytes(build_glb(pieces))
    return path


def test_the_file_has_the_parts_that_are_listed(chair: Path, tmp_path: Path) -> None:
    output = tmp_path / "parts.glb"
    given = "inspect --json --source-noun chair --front 0 --parts-glb"
    shown = [part["name"] for part in json.loads(done(given, str(output), str(chair)).stdout)["parts"]]
    asset = load_asset(output.read_bytes())
    found = parts_of(asset)
    assert sorted(found) == sorted(shown) != []
    nodes = {each["name"]: each["index"] for each in asset.pieces().nodes}
    np.testing.assert_array_equal(found["back"], asset.pieces().in_node(nodes["Back"]))
    legs = sum(asset.pieces().in_node(nodes[name]) for name in nodes if name.startswith("Leg"))
    np.testing.assert_array_equal(found["legs"], legs > 0)


@each_case("form", ["materials", "nodes"])
def test_parts_have_their_names_in_each_form(chair: Path, tmp_path: Path, form: str) -> None:
    output = tmp_path / f"{form}.glb"
    given = "inspect --source-noun chair --front 0 --parts-as"
    said = done(given, form, "--parts-glb", str(output), str(chair)).stderr
    root = unpack(output.read_bytes())[0]
    assert {"legs", "back"} <= {each.get("name") for each in root[form]}
    assert f"as {form}: " in said


def test_a_file_is_not_replaced_and_must_be_a_glb(chair: Path, tmp_path: Path) -> None:
    output = tmp_path / "parts.glb"
    output.write_bytes(b"mine")
    assert "exists" in refused("inspect --parts-glb", str(output), str(chair))
    assert output.read_bytes() == b"mine"
    assert "input" in refused("inspect --force --parts-glb", str(chair), str(chair))
    assert ".glb" in refused("inspect --parts-glb", str(tmp_path / "parts.obj"), str(chair))
    done("inspect --force --source-noun chair --front 0 --parts-glb", str(output), str(chair))
    assert output.read_bytes()[:4] == b"glTF"


def test_an_asset_without_parts_is_refused(tmp_path: Path) -> None:
    path, output = tmp_path / "box.glb", tmp_path / "parts.glb"
    solid = box(2)
    path.write_bytes(build_glb(solid.verts, solid.faces))
    # A heart is a single part, which is all of it.
    assert "No part" in refused("inspect --source-noun heart --front 0 --parts-glb", str(output), str(path))
    assert not output.exists()
