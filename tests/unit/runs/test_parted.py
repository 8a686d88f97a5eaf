"""The parts of a body as parts of the file: every triangle of a part, also those without an area."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.assets.parted import PartsAs, parts_of, with_parts
from meshdeform.errors import PartNotFoundError
from meshdeform.plain.body import loose_body
from meshdeform.plain.naming import NamedPart, find_parts
from meshdeform.runs.parted import given_parts, named_glb, parts_glb
from tests.unit.assets.builders import QUAD_FACES, QUAD_VERTS, Builder, quad, unpack
from tests.unit.plain.test_change import read, two_nodes


def test_a_triangle_without_an_area_has_the_part_of_its_neighbour() -> None:
    builder = Builder()
    faces = np.concatenate([[[3, 3, 1]], QUAD_FACES, [[0, 1, 1]]]).astype(np.uint16)
    builder.node(builder.mesh(builder.primitive(QUAD_VERTS, faces)), name="Board")
    asset = load_asset(builder.glb())
    body = loose_body(asset)
    assert len(body.faces) == 2
    whole = NamedPart("head", "names", np.ones(2, bool), ())
    both = [whole, NamedPart("neck", "names", np.array([True, False]), ())]
    data, names = named_glb(asset, PartsAs.NODES, body, both)
    root = unpack(data)[0]
    assert names == ["head", "neck"]
    # Nothing is left for the node itself, and of parts that overlap the first counts.
    assert [node.get("name") for node in root["nodes"]] == ["Board", "head"]
    assert "mesh" not in root["nodes"][0]
    half = NamedPart("neck", "names", np.array([True, False]), ())
    parts = parts_of(load_asset(named_glb(asset, PartsAs.ATTRIBUTE, body, [half])[0]))
    np.testing.assert_array_equal(parts["neck"], [True, True, False, True])


def test_parts_that_the_file_names_are_given() -> None:
    asset = load_asset(two_nodes("A", "B"))
    top = asset.surface.positions[asset.surface.triangles].mean(1)[:, 1] > 1
    named = load_asset(with_parts(asset, {"Antenna": top, "nothing": ~top & top, "(2)": ~top}))
    body = loose_body(named)
    given = given_parts(named, body)
    assert list(given) == ["antenna"]
    np.testing.assert_array_equal(given["antenna"], top)
    found = {part.name: part for part in find_parts(replace(body, painted=given), read)}
    assert found["antenna"].found_by == "given"
    np.testing.assert_array_equal(found["antenna"].inside, top)
    assert given_parts(asset, loose_body(asset)) == {}


def test_an_asset_without_parts_is_refused() -> None:
    with pytest.raises(PartNotFoundError, match="No part of the asset was found"):
        parts_glb(load_asset(quad()), PartsAs.ATTRIBUTE)
