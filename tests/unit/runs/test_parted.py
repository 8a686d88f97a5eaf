"""The parts of a body as parts of the file: every triangle of a part, also those without an area."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.assets.parted import PartsAs, parts_of
from meshdeform.errors import PartNotFoundError
from meshdeform.plain.body import loose_body
from meshdeform.plain.naming import NamedPart
from meshdeform.runs.parted import named_glb, parts_glb
from tests.unit.assets.builders import QUAD_FACES, QUAD_VERTS, Builder, quad, unpack


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


def test_an_asset_without_parts_is_refused() -> None:
    with pytest.raises(PartNotFoundError, match="No part of the asset was found"):
        parts_glb(load_asset(quad()), PartsAs.ATTRIBUTE)
