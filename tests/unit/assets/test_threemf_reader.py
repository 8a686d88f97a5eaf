"""3MF is read as printers and CAD write it, and within limits."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.inspect import inspect_asset
from meshdeform.errors import AssetError, AssetFormatError, AssetTooLargeError
from tests.unit.assets.archives import packed
from tests.unit.assets.builders import QUAD_VERTS, unpack
from tests.unit.assets.test_formats import COLORED, COLORS_3MF, threemf
from tests.unit.assets.test_replace import accessor

TURN = "0 1 0 -1 0 0 0 0 1 5 0 0"
"""A quarter turn about z, and five along x, for row vectors."""


def model_of(data: bytes) -> str:
    return zipfile.ZipFile(io.BytesIO(data)).read("3D/3dmodel.model").decode()


def whole(model: str) -> bytes:
    return packed({"[Content_Types].xml": b"<Types/>", "3D/3dmodel.model": model.encode()})


def objects(count: int, parts: int) -> str:
    """Return objects of which each has the one before several times."""
    below = [f'<component objectid="{n + 1}"/>' * parts for n in range(count)]
    return "".join(f'<object id="{n + 2}"><components>{each}</components></object>' for n, each in enumerate(below))


def test_components_are_placed_as_their_transforms_say() -> None:
    part = '<component objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>'
    mirrored = f'<object id="9"><components>{part}</components></object></resources>'
    model = model_of(threemf(items=f'<item objectid="9" transform="{TURN}"/>')).replace("</resources>", mirrored)
    asset = load_asset(whole(model), "a.3mf")
    expected = np.array([[5 - y, -x, z] for x, y, z in QUAD_VERTS.tolist()])
    np.testing.assert_allclose(asset.surface.positions, expected)
    a, b, c = asset.surface.positions[asset.surface.triangles[0]]
    assert np.cross(b - a, c - a)[2] > 0  # a mirror turns the corners round, so that the outside stays outside
    assert (asset.unit, asset.up) == (0.0254, "z")


def test_corners_have_their_colours() -> None:
    root, chunk, _ = unpack(load_asset(threemf(COLORED, COLORS_3MF), "a.3mf").to_bytes())
    primitive = root["meshes"][0]["primitives"][0]
    view = root["bufferViews"][root["accessors"][primitive["indices"]]["bufferView"]]
    corners = np.frombuffer(chunk, np.uint16, 6, view["byteOffset"])
    colors = accessor(root, chunk, primitive["attributes"]["COLOR_0"])[corners]
    red, blue = [1, 0, 0, 1], [0, 0, 1, 128 / 255]
    np.testing.assert_allclose(colors, [red, red, red, red, blue, blue], atol=1e-6)


def test_objects_of_other_files_are_read() -> None:
    other = model_of(threemf(items="")).encode()
    main = b"""<model xmlns:p="p"><resources><object id="4"><components>
      <component objectid="1" p:path="/3D/Objects/a.model"/></components></object></resources>
      <build><item objectid="4"/></build></model>"""
    files = {"[Content_Types].xml": b"", "3D/3dmodel.model": main, "3D/Objects/a.model": other}
    assert len(load_asset(packed(files), "a.3mf").surface.triangles) == 2
    assert len(load_asset(packed(files), "a.zip").surface.triangles) == 2
    assert inspect_asset(packed(files), "a.3mf").format == "3mf"
    del files["3D/Objects/a.model"]
    with pytest.raises(AssetError, match=r"a\.model"):
        load_asset(packed(files), "a.3mf")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</resources>", "", "no XML"),
        ('v1="0"', 'v1="9"', "a vertex that it has not"),
        ('v1="0"', 'v1="a"', "cannot be read"),
        ('objectid="1"', 'objectid="7"', "no object '7'"),
        ('objectid="1"', 'objectid="1" transform="1 0 0"', "cannot be read"),
        ('objectid="1"', 'objectid="1" transform="inf 0 0 0 1 0 0 0 1 0 0 0"', "not finite"),
    ],
)
def test_damage_is_named(old: str, new: str, message: str) -> None:
    with pytest.raises(AssetError, match=message):
        load_asset(whole(model_of(threemf()).replace(old, new, 1)), "a.3mf")


def test_a_document_type_is_refused_before_it_can_grow() -> None:
    bomb = '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]><model unit="&b;"/>'
    with pytest.raises(AssetError, match="document type"):
        load_asset(whole(bomb), "a.3mf")


@pytest.mark.parametrize(
    ("more", "item", "error"),
    [
        (objects(60, 2), 61, AssetTooLargeError),  # 2 ** 60 copies
        (objects(100, 1), 101, None),
        ('<object id="2"><components><component objectid="2"/></components></object>', 2, AssetError),
    ],
)
def test_what_repeats_is_counted_before_it_is_copied(more: str, item: int, error: type[AssetError] | None) -> None:
    model = model_of(threemf(items=f'<item objectid="{item}"/>')).replace("</resources>", more + "</resources>")
    if error is None:  # deep, but no more than one copy
        assert len(load_asset(whole(model), "a.3mf").surface.triangles) == 2
        return
    with pytest.raises(error):
        load_asset(whole(model), "a.3mf")


def test_the_rules_for_a_zip_hold() -> None:
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", b" " * 100_000)
    with pytest.raises(AssetTooLargeError, match="more than 1 triangles"):
        load_asset(threemf(), "a.3mf", Limits(max_triangles=1))
    with pytest.raises(AssetTooLargeError, match="unpacks to"):
        load_asset(bomb.getvalue(), "a.3mf", Limits(max_bytes=10_000))
    with pytest.raises(AssetError, match="outside itself"):
        load_asset(packed({"../a": b"", "3D/3dmodel.model": b"<model/>"}), "a.3mf")
    with pytest.raises(AssetFormatError, match="content is something else"):
        load_asset(b"no zip at all", "a.3mf")
