"""Bad meshes go the cheapest way of `bench.bad_meshes`: no face is flipped, and nothing comes apart."""

from __future__ import annotations

import pytest

from bench.bad_meshes import problems, torn
from bench.input_meshes import BAD, INPUTS
from bench.inputs import glb
from meshdeform.assets import load_asset
from meshdeform.geometry.weld import weld
from meshdeform.runs import reading
from tests.cases import each_case

BOTTLES = [name for name in BAD if name not in INPUTS]


@each_case("name", BOTTLES)
def test_a_bad_mesh_is_bent_without_harm(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "read_source", lambda *_: None)  # a twist is the same, whatever it is of
    assert problems(BAD[name](0.3), "twisted") == []


def test_what_comes_apart_is_seen() -> None:
    for name, moved, what in (("t-junctions", -1, "T-junctions opened"), ("unwelded", 0, "vertices came apart")):
        surface = load_asset(glb(BAD[name](0.3))).surface
        welded = weld(surface.positions, surface.triangles)
        new = surface.positions.copy()
        new[moved] += 0.1
        found = torn(surface.positions, new, welded, welded.gather(new).verts)
        assert any(what in each for each in found), name
