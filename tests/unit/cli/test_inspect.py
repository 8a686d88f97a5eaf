"""`--rigid` and `meshdeform inspect`: what is typed selects what is shown."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
import typer
from typer.testing import CliRunner

from meshdeform.assets import build_glb
from meshdeform.cli.app import app
from meshdeform.cli.request import parse_rigid
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import box, join, torus
from meshdeform.requests.document import DeformParams
from tests.cases import each_case


def test_parts_are_written_as_place_and_name() -> None:
    assert parse_rigid(None) is None
    written = ["node=Wheel=1", "material=3", "similarity:component=0", "rigid:node=a:b"]
    parsed = parse_rigid(written)
    assert parsed == [
        {"node": "Wheel=1", "mode": "rigid"},
        {"material": 3, "mode": "rigid"},
        {"component": 0, "mode": "similarity"},
        {"node": "a:b", "mode": "rigid"},
    ]
    assert len(DeformParams.model_validate({"rigid": parsed}).rigid) == 4


@each_case("text", ["wheels", "node=", "mesh=1", "stiff:node=a", "=a"])
def test_anything_else_is_refused_with_the_form(text: str) -> None:
    with pytest.raises(typer.BadParameter, match="PLACE=NAME"):
        parse_rigid([text])


def test_inspect_proposes_options_that_select_the_wheels(tmp_path: Path) -> None:
    wheels = [
        TriangleMesh(0.2 * torus(n=16, m=8).verts + torch.tensor([x, -0.6, 0.0]), torus(n=16, m=8).faces)
        for x in (-0.5, 0.5)
    ]
    cart = join(box(1), *wheels)
    path = tmp_path / "cart.glb"
    path.write_bytes(build_glb(cart.verts.numpy(), cart.faces.numpy(), material="clay"))
    shown = CliRunner().invoke(app, ["inspect", str(path)])
    assert shown.exit_code == 0, shown.output
    assert "2 congruent round components: 1, 2. Keep them with --rigid component=1 --rigid component=2" in shown.output
    assert "Subdivide" in shown.output
    found = json.loads(CliRunner().invoke(app, ["inspect", str(path), "--json"]).stdout)
    assert [item["triangles"] for item in found["components"]] == [12, 256, 256]
    assert found["proposals"][0]["selectors"] == [{"component": 1}, {"component": 2}]
