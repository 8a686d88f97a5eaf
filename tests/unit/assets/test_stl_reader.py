"""STL is read as programs write it: text, binary, with bytes behind it, with colours of facets."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import Limits, load_asset
from meshdeform.errors import AssetError, AssetTooLargeError
from tests.cases import each_case
from tests.unit.assets.builders import unpack
from tests.unit.assets.test_replace import accessor

CORNERS = [[(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(1, 0, 0), (1, 1, 0.5), (0, 1, 0)]]
TEXT = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"


def binary(*attributes: int, head: bytes = b"", behind: bytes = b"") -> bytes:
    """Return two facets with 16 bits each."""
    attributes = attributes or (0, 0)
    facets = [
        struct.pack("<12fH", 0, 0, 1, *np.ravel(corners), number)
        for corners, number in zip(CORNERS, attributes, strict=True)
    ]
    return head.ljust(80, b"\0") + struct.pack("<I", 2) + b"".join(facets) + behind


def colors(data: bytes) -> Any:
    root, chunk, _ = unpack(load_asset(data, "a.stl").to_bytes())
    at = root["meshes"][0]["primitives"][0]["attributes"].get("COLOR_0")
    return None if at is None else accessor(root, chunk, at)[::3, :3].tolist()


@each_case("behind", [b"", b"\0", b"made by a scanner\n", bytes(50), b"endsolid"])
@each_case("head", [b"", b"solid of a program", b"COLOR"])
def test_bytes_behind_the_facets_are_left_out(behind: bytes, head: bytes) -> None:
    surface = load_asset(binary(head=head, behind=behind), "a.stl").surface
    np.testing.assert_array_equal(surface.positions, np.reshape(CORNERS, (-1, 3)))


def test_facets_have_the_colors_of_magics_or_of_viscam() -> None:
    head = b"COLOR=" + bytes([0, 0, 255, 255])
    assert colors(binary(31, 31 << 5, head=head)) == [[1, 0, 0], [0, 1, 0]]
    assert colors(binary(31, 0x8000, head=head)) == [[1, 0, 0], [0, 0, 1]]  # bit 15: the colour of the whole
    assert colors(binary(0, 0, head=head)) == [[0, 0, 1], [0, 0, 1]]
    assert colors(binary(0x8000 | 31, 0x8000 | 31 << 10)) == [[0, 0, 1], [1, 0, 0]]
    assert colors(binary(0x8000 | 31, 0)) == [[0, 0, 1], [1, 1, 1]]
    assert colors(binary(7, 9)) is colors(binary(0x8000 | 0x7FFF, 0x8000 | 0x7FFF)) is None  # no colours


def test_solids_of_a_text_become_meshes_with_their_names() -> None:
    data = b"solid left arm\n" + TEXT + b"endsolid left arm\nSOLID\n" + TEXT.upper() * 2 + b"ENDSOLID\n"
    root, _, _ = unpack(load_asset(data, "a.stl").to_bytes())
    assert [node["name"] for node in root["nodes"]] == ["left arm", "geometry_1"]
    assert len(load_asset(data, "a.stl").surface.triangles) == 3


def test_what_a_text_may_not_have_is_told() -> None:
    for line in (b"vertex 1 0 0\n", b"vertex 0 1 0"):
        with pytest.raises(AssetError, match="three corners"):
            load_asset(b"solid x\n" + TEXT.replace(line, b"") + b"endsolid\n", "a.stl")
    with pytest.raises(AssetTooLargeError, match="3 solids"):
        load_asset((b"solid a\n" + TEXT + b"endsolid\n") * 3, "a.stl", Limits(max_primitives=2))
