"""`--rigid` and `meshdeform inspect`: what is typed selects what is shown."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import typer

from meshdeform.assets import build_glb
from meshdeform.cli.request import read_handle, read_name, read_region, read_rigid
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import join
from meshdeform.requests.document import DeformParams
from tests.cases import each_case
from tests.unit.cli.lines import done, refused
from training.evaluation.sources import source_mesh
from training.shapes import box, torus


def test_parts_are_written_as_place_and_name() -> None:
    written = ["node=Wheel=1", "material=3", "similarity:component=0", "rigid:node=a:b"]
    parsed = [read_rigid(text) for text in written]
    assert parsed == [
        {"node": "Wheel=1", "mode": "rigid"},
        {"material": 3, "mode": "rigid"},
        {"component": 0, "mode": "similarity"},
        {"node": "a:b", "mode": "rigid"},
    ]
    assert len(DeformParams.model_validate({"control": {"rigid": parsed}}).control.rigid) == 4
    assert [read_name(text) for text in ("Ground", "3")] == ["Ground", 3]


def test_inspect_refuses_what_selects_nothing_and_nouns_that_nobody_knows(tmp_path: Path) -> None:
    animal = source_mesh("quadruped")
    path = tmp_path / "animal.glb"
    path.write_bytes(build_glb(animal.verts, animal.faces))
    assert "xyzzy" in refused("inspect --source-noun xyzzy", str(path))
    assert "no node named 'Ear'" in refused(
        "inspect --source-noun dog --front 0 --set", 'parts=[{"name": "ear", "node": "Ear"}]', str(path)
    )


def test_inspect_proposes_options_that_select_the_wheels(tmp_path: Path) -> None:
    wheels = [
        TriangleMesh(0.2 * torus(n=16, m=8).verts + np.array([x, -0.6, 0.0]), torus(n=16, m=8).faces)
        for x in (-0.5, 0.5)
    ]
    cart = join(box(1), *wheels)
    path = tmp_path / "cart.glb"
    path.write_bytes(build_glb(cart.verts, cart.faces, material="clay"))
    shown = done("inspect --source-noun car --front 90", str(path))
    assert "Given: car; front at 90 degrees (0 is +Z, 90 is +X), as given." in shown.output
    assert "2 congruent round components: 1, 2. Keep them with --rigid component=1 --rigid component=2" in shown.output
    painted = 'parts=[{"name": "hub", "faces": [[0, 5]]}]'
    found = json.loads(done("inspect --json --source-noun car --front 90 --set", painted, str(path)).stdout)
    assert (found["reading"]["noun"], found["reading"]["front_azimuth_deg"]) == ("car", 90.0)
    assert {"name": "hub", "found_by": "given", "confidence": None} in found["parts"]
    assert [item["triangles"] for item in found["components"]] == [12, 256, 256]
    assert found["symmetry"] == ["x", "z"]
    assert found["box"]["max"] == pytest.approx([0.69, 0.5, 0.5])
    assert "Symmetric along x, z." in shown.output
    assert found["proposals"][0]["selectors"] == [{"component": 1}, {"component": 2}]


def test_regions_and_handles_are_written_as_place_and_value() -> None:
    keep = ["node:Door", "box=-1,0,-1,1,2,1", "sphere:0,1,0,0.5", "capsule=0,0,0,0,1,0,0.2", "faces=3,5-9"]
    only = ["joint=Head,0.3", "color=1,0,0", "mesh=2", "material=a=b", "component=4"]
    regions = [read_region(action, text) for action, texts in (("keep", keep), ("only", only)) for text in texts]
    assert [next(iter(region.items())) for region in regions] == [
        ("node", "Door"),
        ("box", {"min": [-1, 0, -1], "max": [1, 2, 1]}),
        ("sphere", {"center": [0, 1, 0], "radius": 0.5}),
        ("capsule", {"start": [0, 0, 0], "end": [0, 1, 0], "radius": 0.2}),
        ("faces", [3, [5, 9]]),
        ("joint", {"name": "Head", "above": 0.3}),
        ("color", {"rgb": [1, 0, 0]}),
        ("mesh", 2),
        ("material", "a=b"),
        ("component", 4),
    ]
    handles = [read_handle(text) for text in ("vertex=12:0,1,0", "position=0,0.5,0:0,1,0@0.25")]
    assert handles == [
        {"vertex": 12, "to": [0, 1, 0]},
        {"position": [0, 0.5, 0], "to": [0, 1, 0], "weight": 0.25},
    ]
    found = DeformParams.model_validate({"control": {"regions": regions, "handles": handles}})
    assert [region.action for region in found.control.regions] == ["keep"] * 5 + ["only"] * 5


@each_case(
    ("read", "texts"),
    [
        (read_rigid, ["wheels", "node=", "part=1", "stiff:node=a", "=a", "component=x", "box=1,2"]),
        (read_handle, ["vertex=1", "vertex=x:0,0,0", "position=0,0:1,1,1", "corner=1:0,0,0", "vertex=1:0,0,0@much"]),
    ],
)
def test_anything_else_is_refused_with_the_form(read: Callable[[str], object], texts: list[str]) -> None:
    for text in texts:
        with pytest.raises(typer.BadParameter, match=r" is not |position=X,Y,Z:X,Y,Z"):
            read(text)
