"""Documents that are valid but unusual, and errors that name the right reason."""

from __future__ import annotations

import base64

import numpy as np
import pytest

from meshdeform.assets import inspect_asset, load_asset
from meshdeform.errors import AssetEmptyError, AssetError
from tests.unit.assets.builders import QUAD_NORMALS, QUAD_VERTS, Builder, notable, pack, quad, unpack
from tests.unit.assets.test_replace import position


def test_a_data_uri_in_buffer_0_beside_a_binary_chunk_is_written_correctly() -> None:
    root, binary, _ = unpack(quad())
    root["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    asset = load_asset(pack(root, b"nobody refers to these bytes"), "quad.glb")
    moved = asset.surface.positions + np.array([1.0, 2.0, 3.0])
    again = load_asset(asset.replace(moved), "quad.glb")
    np.testing.assert_allclose(again.surface.positions, moved, atol=1e-6)
    np.testing.assert_array_equal(again.surface.triangles, asset.surface.triangles)


def test_integers_may_be_written_as_floats() -> None:
    def as_floats(value: object) -> object:
        if isinstance(value, dict):
            return {key: as_floats(item) for key, item in value.items()}
        if isinstance(value, list):
            return [as_floats(item) for item in value]
        return float(value) if isinstance(value, int) and not isinstance(value, bool) else value

    root, binary, _ = unpack(quad())
    floats = as_floats(root)
    assert isinstance(floats, dict)
    expected, asset = load_asset(quad(), "quad.glb"), load_asset(pack(floats, binary), "quad.glb")
    np.testing.assert_array_equal(asset.surface.positions, expected.surface.positions)
    moved = asset.surface.positions + 1.0
    assert load_asset(asset.replace(moved), "quad.glb").summary.triangles == 2
    floats["nodes"][0]["mesh"] = 0.5
    with pytest.raises(AssetError, match="must be an index"):
        load_asset(pack(floats, binary), "quad.glb")


def test_a_file_that_shows_nothing_is_told_why() -> None:
    root, binary, _ = unpack(quad())
    root["scenes"], root["scene"] = [{"nodes": []}], 0
    with pytest.raises(AssetEmptyError, match="shows no mesh") as raised:
        load_asset(pack(root, binary), "quad.glb")
    assert "scene" in raised.value.advice_text
    root, binary, _ = unpack(quad())
    root["nodes"] = [{"name": "empty"}]
    with pytest.raises(AssetEmptyError, match="contains 1 mesh, but no node shows") as raised:
        load_asset(pack(root, binary), "quad.glb")
    assert "scene" in raised.value.advice_text
    with pytest.raises(AssetEmptyError, match="contains no mesh"):
        load_asset(pack({"asset": {"version": "2.0"}}), "quad.glb")


def instanced() -> Builder:
    """Return a quad that is drawn three times; the first instance is flattened."""
    builder = Builder()
    attributes = {
        "TRANSLATION": builder.accessor(np.float32([[0, 0, 0], [5, 0, 0], [9, 0, 0]])),
        "ROTATION": builder.accessor(np.float32([[0, 0, 0, 1], [0, 1, 0, 0], [0, 0, 0, 1]])),
        "SCALE": builder.accessor(np.float32([[1, 0, 1], [2, 2, 2], [1, 1, 1]])),
        "_ID": builder.accessor(np.float32([0, 1, 2])),
    }
    many = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    builder.node(builder.mesh(builder.primitive(NORMAL=QUAD_NORMALS)), translation=[0, 1, 0], extensions=many)
    builder.root["extensionsUsed"] = builder.root["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    return builder


def test_an_instanced_mesh_is_deformed_once_and_keeps_its_instances() -> None:
    builder = instanced()
    asset = load_asset(builder.glb(), "quads.glb")
    expected = QUAD_VERTS * [-2.0, 2.0, -2.0] + [5.0, 1.0, 0.0]  # half a turn about y
    np.testing.assert_allclose(asset.surface.positions, expected, atol=1e-12)
    assert asset.summary.skipped == ()
    assert "draws 1 mesh 3 times" in asset.summary.warnings[0]
    assert inspect_asset(builder.glb()).warnings == notable(asset)
    written = asset.replace(asset.surface.positions + [0.0, 2.0, 0.0])
    np.testing.assert_allclose(position(written), QUAD_VERTS + np.float32([0, 1, 0]), atol=1e-6)
    before, after = unpack(builder.glb())[0], unpack(written)[0]
    assert after["nodes"] == before["nodes"]
    assert after["accessors"][:4] == before["accessors"][:4]
    for change in ({"count": 2}, {"type": "VEC2"}, {"componentType": 5123}):
        builder = instanced()
        builder.root["accessors"][2] |= change
        with pytest.raises(AssetError, match="EXT_mesh_gpu_instancing"):
            load_asset(builder.glb())


def test_materials_that_are_none_have_no_name() -> None:
    for materials, material in ([None, "red"], 0), ("none", 0), ([5], 0), ([{"name": 7}], "0"), ([{}], True):
        root, binary, _ = unpack(quad())
        root["meshes"][0]["primitives"][0]["material"] = material
        root["materials"] = materials
        assert load_asset(pack(root, binary)).summary.materials in ((), ({"index": 0, "name": ""},))


def test_materials_that_the_file_does_not_have_are_no_parts() -> None:
    root, binary, _ = unpack(quad())
    root["materials"] = [{"name": "red"}]
    for material in (1, 2**80):
        root["meshes"][0]["primitives"][0]["material"] = material
        assert load_asset(pack(root, binary)).summary.materials == ()
