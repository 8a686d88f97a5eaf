"""The asset comes back whole: only what the deformation changes is new."""

from __future__ import annotations

import base64
import copy
import json
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.errors import NumericalError, ShapeError
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_TANGENTS, QUAD_VERTS, Builder, quad, unpack

TILT = {"rotation": [0.1, 0.2, 0.3, 0.927361849549570], "scale": [2.0, -0.5, 3.0], "translation": [1, 2, 3]}


def accessor(root: dict[str, Any], binary: bytes, at: int) -> np.ndarray:
    item = root["accessors"][at]
    view = root["bufferViews"][item["bufferView"]]
    start = view.get("byteOffset", 0) + item.get("byteOffset", 0)
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[item["type"]]
    assert item["componentType"] == 5126
    return np.frombuffer(binary, np.float32, item["count"] * width, start).reshape(-1, width)


def position(glb: bytes, mesh: int = 0, primitive: int = 0, name: str = "POSITION") -> np.ndarray:
    root, binary, _ = unpack(glb)
    return accessor(root, binary, root["meshes"][mesh]["primitives"][primitive]["attributes"][name])


def rich() -> Builder:
    """A document with something of everything that must survive."""
    builder = Builder()
    primitive = builder.primitive(NORMAL=QUAD_NORMALS, TANGENT=QUAD_TANGENTS, TEXCOORD_0=QUAD_VERTS[:, :2].copy())
    primitive |= {"material": 0, "extras": {"p": 1.50}, "extensions": {"X_variants": {"mappings": [{"material": 0}]}}}
    builder.node(
        builder.mesh(primitive, name="m", extras=[1.0, {"x": 0.1000}]), name="n", extensions={"X_unknown": {"k": [1]}}
    )
    builder.root["asset"] |= {"extras": {"author": "é"}, "generator": "hand"}
    builder.root["materials"] = [{"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.10, 0, 1]}}]
    builder.root["extensionsUsed"] = ["X_unknown", "X_variants"]
    builder.root["X_top"] = {"order": [3, 1, 2]}
    return builder


def test_identity_gives_equal_accessors_and_leaves_the_rest() -> None:
    glb = rich().glb((b"XTRA", b"abcd"))
    asset = load_asset(glb)
    surface = asset.surface
    written = asset.replace(surface.positions, surface.normals, surface.tangents)
    before, binary_before, rest_before = unpack(glb)
    after, binary, rest = unpack(written)
    assert binary.startswith(binary_before)
    assert rest == rest_before
    for name, values in (("POSITION", QUAD_VERTS), ("NORMAL", QUAD_NORMALS), ("TANGENT", QUAD_TANGENTS)):
        np.testing.assert_array_equal(position(written, name=name), values)
    # Everything but the three attributes, the new accessors and the buffer's length is the same.
    attributes = after["meshes"][0]["primitives"][0]["attributes"]
    old = before["meshes"][0]["primitives"][0]["attributes"]
    assert {name for name in old if attributes[name] != old[name]} == {"POSITION", "NORMAL", "TANGENT"}
    attributes |= old
    for key in ("accessors", "bufferViews"):
        assert after[key][: len(before[key])] == before[key]
        after[key] = before[key]
    after["buffers"] = before["buffers"]
    assert after == before
    assert list(after) == list(before)
    assert b'"baseColorFactor":[1.0,0.1,0,1]' in written  # floats stay floats, integers stay integers


@each_case(
    "transform",
    [{}, TILT, {"scale": [1e-4, 1e-4, 1e-4]}, {"matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 2, 0, 5, 6, 7, 1]}],
)
def test_what_moves_is_read_back_in_the_world_and_what_does_not_keeps_its_bits(transform: dict[str, Any]) -> None:
    asset = load_asset(quad(**transform))
    surface = asset.surface
    written = asset.replace(surface.positions, surface.normals, surface.tangents)
    for name, values in (("POSITION", QUAD_VERTS), ("NORMAL", QUAD_NORMALS), ("TANGENT", QUAD_TANGENTS)):
        np.testing.assert_array_equal(position(written, name=name), values)
    rng = np.random.default_rng(0)
    moved, normals = surface.positions + rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tangents = np.column_stack([np.cross(normals, [0.0, 0.0, 1.0]), [1.0, -1.0, 1.0, -1.0]])
    tangents[:, :3] /= np.linalg.norm(tangents[:, :3], axis=1, keepdims=True)
    again = load_asset(asset.replace(moved, normals, tangents)).surface
    for found, wanted in ((again.positions, moved), (again.normals, normals), (again.tangents, tangents)):
        np.testing.assert_allclose(found, wanted, atol=1e-5)
    np.testing.assert_array_equal(again.triangles, surface.triangles)


def test_normals_are_replaced_where_there_were_some_and_new_ones_have_a_direction() -> None:
    asset = load_asset(quad())
    root, _, _ = unpack(asset.replace(asset.surface.positions + 1))
    attributes = root["meshes"][0]["primitives"][0]["attributes"]
    assert (attributes["NORMAL"], attributes["TANGENT"]) == (1, 2)
    normals = -asset.surface.normals
    normals[1] = np.nan
    written = position(asset.replace(asset.surface.positions, normals), name="NORMAL")
    np.testing.assert_allclose(written, np.where([[0], [1], [0], [0]], QUAD_NORMALS, -QUAD_NORMALS), atol=1e-7)
    strip = Builder()
    strip.node(strip.mesh({**strip.primitive(faces=np.arange(4, dtype=np.uint8)), "mode": 5}))
    asset = load_asset(strip.glb())
    root, _, _ = unpack(asset.replace(asset.surface.positions, np.ones((4, 3)), np.ones((4, 4))))
    primitive = root["meshes"][0]["primitives"][0]
    assert set(primitive["attributes"]) == {"POSITION"}
    assert (primitive["mode"], primitive["indices"]) == (5, 1)


def test_each_deformed_instance_gets_its_own_mesh_and_the_first_keeps_the_index() -> None:
    builder = rich()
    builder.node(0, translation=[3, 0, 0])
    builder.node(0, translation=[6, 0, 0])
    asset = load_asset(builder.glb())
    moved = asset.surface.positions + np.repeat([[0.0, 1, 0], [0, 2, 0], [0, 3, 0]], 4, axis=0)
    written = asset.replace(moved)
    root, _, _ = unpack(written)
    assert [node["mesh"] for node in root["nodes"]] == [0, 1, 2]
    for mesh, y in enumerate((1, 2, 3)):
        np.testing.assert_array_equal(position(written, mesh), QUAD_VERTS + np.float32([0, y, 0]))
        copied = copy.deepcopy(root["meshes"][mesh])
        copied["primitives"][0]["attributes"].pop("POSITION")
        original = unpack(builder.glb())[0]["meshes"][0]
        original["primitives"][0]["attributes"].pop("POSITION")
        assert copied == original  # name, extras, variants and materials came along
    np.testing.assert_allclose(load_asset(written).surface.positions, moved)


def test_a_node_that_is_not_deformed_keeps_the_mesh() -> None:
    builder = rich()
    hidden = builder.node(0, in_scene=False)
    asset = load_asset(builder.glb())
    written = asset.replace(asset.surface.positions + 1)
    root, _, _ = unpack(written)
    assert root["nodes"][hidden]["mesh"] == 0
    assert root["nodes"][0]["mesh"] == 1
    np.testing.assert_array_equal(position(written, 0), QUAD_VERTS)
    np.testing.assert_array_equal(position(written, 1), QUAD_VERTS + 1)


def test_what_shares_an_accessor_and_is_not_deformed_stays() -> None:
    builder = Builder()
    shared = builder.primitive(NORMAL=QUAD_NORMALS)
    shared["targets"] = [{"POSITION": shared["attributes"]["POSITION"]}]
    builder.node(builder.mesh(shared))
    other = builder.mesh({**shared, "attributes": dict(shared["attributes"])})
    asset = load_asset(builder.glb())
    written = asset.replace(asset.surface.positions * 2, asset.surface.normals)
    root, binary, _ = unpack(written)
    np.testing.assert_array_equal(position(written, 0, 0), QUAD_VERTS * 2)
    np.testing.assert_array_equal(position(written, other), QUAD_VERTS)
    target = root["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    np.testing.assert_array_equal(accessor(root, binary, target), QUAD_VERTS)


def test_primitives_that_shared_accessors_go_on_sharing() -> None:
    builder = Builder()
    first = builder.primitive(faces=QUAD_FACES[:1])
    second = {"attributes": dict(first["attributes"]), "indices": builder.accessor(QUAD_FACES[1])}
    builder.node(builder.mesh(first, second))
    asset = load_asset(builder.glb())
    root, _, _ = unpack(asset.replace(asset.surface.positions * 2))
    a, b = (primitive["attributes"]["POSITION"] for primitive in root["meshes"][0]["primitives"])
    assert a == b


def test_the_asset_itself_does_not_change() -> None:
    glb = rich().glb((b"XTRA", b"abcd"))
    asset = load_asset(glb)
    first = asset.replace(asset.surface.positions * np.pi, asset.surface.normals)
    assert asset.replace(asset.surface.positions * np.pi, asset.surface.normals) == first
    assert asset.to_bytes() == glb
    root, _, _ = unpack(first)
    item = root["accessors"][root["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
    for bound in ("min", "max"):  # exactly those of the floats
        assert item[bound] == [float(value) for value in getattr(position(first), bound)(axis=0)]


def text_gltf() -> bytes:
    """Return a glTF JSON with two embedded buffers and an image that is a data URI."""
    first, second = Builder(), Builder()
    primitive = first.primitive(faces=None)
    indices = second.accessor(QUAD_FACES.reshape(-1))
    root = {key: value for key, value in first.root.items() if value}
    root["accessors"].append(second.root["accessors"][indices] | {"bufferView": 1})
    root["bufferViews"].append(second.root["bufferViews"][0] | {"buffer": 1})
    root["meshes"] = [{"primitives": [{**primitive, "indices": 1}]}]
    root["nodes"], root["scenes"] = [{"mesh": 0}], [{"nodes": [0]}]
    root["buffers"] = [
        {"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}
        for data in (first.binary, second.binary)
    ]
    root["images"] = [{"name": "dot", "uri": "data:image/png;base64," + base64.b64encode(DOT).decode()}]
    return json.dumps(root).encode()


DOT = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg=="
)
"""A PNG of one pixel."""


@each_case("how", ["replace", "to_bytes"])
def test_data_uris_move_into_the_binary_chunk(how: str) -> None:
    asset = load_asset(text_gltf(), "a.gltf")
    written = asset.replace(asset.surface.positions) if how == "replace" else asset.to_bytes()
    assert b"data:" not in written
    root, binary, _ = unpack(written)
    assert len(root["buffers"]) == 1
    image = root["images"][0]
    assert (image["name"], image["mimeType"]) == ("dot", "image/png")
    view = root["bufferViews"][image["bufferView"]]
    assert binary[view["byteOffset"] :][: view["byteLength"]] == DOT
    again = load_asset(written).surface
    np.testing.assert_array_equal(again.positions, QUAD_VERTS)
    np.testing.assert_array_equal(again.triangles, QUAD_FACES)


def test_what_a_file_cannot_hold_is_refused() -> None:
    asset = load_asset(quad())
    for bad in (np.nan, np.inf, 1e39):
        positions = asset.surface.positions.copy()
        positions[0, 0] = bad
        with pytest.raises(NumericalError):
            asset.replace(positions)
    with pytest.raises(ShapeError):
        asset.replace(asset.surface.positions[:3])
    with pytest.raises(ShapeError):
        asset.replace(asset.surface.positions, asset.surface.tangents)
