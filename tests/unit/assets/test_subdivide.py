"""`Asset.subdivided`: boxes become able to bend, without gaps, and keep everything that a file can attach to them."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshdeform.assets import load_asset
from meshdeform.assets.accessors import read_accessor
from meshdeform.assets.document import Document
from meshdeform.assets.limits import Limits
from meshdeform.assets.subdivide import MAX_TRIANGLES, middles
from meshdeform.geometry.mesh import edges_of
from meshdeform.geometry.weld import weld
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_FACES, Builder, unpack
from tests.unit.assets.test_fuzz import kitchen_sink

SQUARE = np.array([[-1, -1, 1], [1, -1, 1], [-1, 1, 1], [1, 1, 1]], np.float32)
UVS = (SQUARE[:, :2] + 1) / 2
TURNS = [[0, 0, 0, 1], [0, 1, 0, 0], [0, 0.5**0.5, 0, 0.5**0.5], [0, -(0.5**0.5), 0, 0.5**0.5]]
TURNS += [[0.5**0.5, 0, 0, 0.5**0.5], [-(0.5**0.5), 0, 0, 0.5**0.5]]


def box(**more: Any) -> Builder:
    """Return a box of 12 triangles: five nodes of one mesh, and another mesh, half as large, that is scaled up."""
    builder = Builder()
    normals, faces = np.tile(np.float32([0, 0, 1]), (4, 1)), QUAD_FACES
    side = builder.mesh(builder.primitive(SQUARE, faces, NORMAL=normals, TEXCOORD_0=UVS, **more))
    small = builder.mesh(builder.primitive(SQUARE / 2, faces[:, [1, 2, 0]], NORMAL=normals, TEXCOORD_0=UVS, **more))
    for turn in TURNS[:-1]:
        builder.node(side, rotation=turn)
    builder.node(small, rotation=TURNS[-1], scale=[2, 2, 2], name="top")
    return builder


def volume(positions: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = positions[triangles].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


def edge_lengths(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    corners = positions[triangles]
    return np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2)


def test_a_box_in_six_nodes_stays_closed_and_keeps_its_shape_and_its_uvs() -> None:
    source = load_asset(box().glb())
    made, done = source.subdivided(MAX_TRIANGLES)
    surface = made.surface
    assert (done.triangles_before, done.triangles_after, done.limited) == (12, 3072, False)
    assert len(surface.triangles) == 3072
    assert edge_lengths(surface.positions, surface.triangles).max() <= 0.1 * 2
    assert np.isclose(volume(surface.positions, surface.triangles), 8)
    welded = weld(surface.positions, surface.triangles)
    assert welded.skipped["border_edges"] == welded.skipped["non_manifold_edges"] == 0
    assert len(welded.mesh.verts) == 3072 // 2 + 2  # Euler: a sphere without a gap or a T-junction
    assert "cannot bend" in source.summary.warnings[-1]
    assert not made.summary.warnings
    root, _, _ = unpack(made.to_bytes())
    assert [node.get("name") for node in root["nodes"]] == [None] * 5 + ["top"]
    for mesh, scale in ((0, 1), (1, 0.5)):
        attributes = root["meshes"][mesh]["primitives"][0]["attributes"]
        document = Document.parse(made.to_bytes(), Limits(), glb=True)
        place, uv = (read_accessor(document, attributes[name]) for name in ("POSITION", "TEXCOORD_0"))
        np.testing.assert_allclose(uv, (place[:, :2] / scale + 1) / 2, atol=1e-7)


def test_an_edge_that_is_long_in_one_instance_only_is_split_wherever_it_is() -> None:
    """Of two instances one is small, and a third, fine mesh touches it: no vertex may come to lie on an edge."""
    builder = Builder()
    quad = builder.mesh(builder.primitive(SQUARE * np.float32([1, 1, 0])))
    builder.node(quad, scale=[10, 10, 1])
    builder.node(quad, translation=[10.5, 9.5, 0], scale=[0.5, 0.5, 1])
    touching = builder.mesh(builder.primitive(SQUARE * np.float32([1, 1, 0])))
    builder.node(touching, translation=[11.5, 9.5, 0], scale=[0.5, 0.5, 1])
    made, _ = load_asset(builder.glb()).subdivided(MAX_TRIANGLES)
    shared = made.surface.positions[made.surface.instance_of_vertex > 0]
    labels = made.surface.instance_of_vertex[made.surface.instance_of_vertex > 0]
    left, right = (np.unique(shared[(labels == k) & np.isclose(shared[:, 0], 11)][:, 1].round(6)) for k in (1, 2))
    assert len(left) > 2
    np.testing.assert_array_equal(left, right)


def test_the_number_of_triangles_is_limited_and_fine_assets_stay_as_they_are() -> None:
    source = load_asset(box().glb())
    made, done = source.subdivided(1000)
    assert done.limited
    assert 100 < len(made.surface.triangles) == done.triangles_after <= 1000
    fine, _ = source.subdivided(MAX_TRIANGLES)
    again, nothing = fine.subdivided(MAX_TRIANGLES)
    assert again is fine
    assert not nothing.split
    half = source.subdivided(300)[0].surface  # stops in the middle, with triangles of all patterns
    edges = edges_of(weld(half.positions, half.triangles).mesh.faces)
    assert bool(((edges.counts == 2) & edges.consistent).all())


def test_everything_attached_to_a_source_stays() -> None:
    source = load_asset(kitchen_sink())
    made, done = source.subdivided(MAX_TRIANGLES)
    assert done.split
    before, _, _ = unpack(kitchen_sink())
    after, _, rest = unpack(made.to_bytes())
    assert rest.endswith(b"abcd")
    for key in ("nodes", "scenes", "materials", "images", "textures", "cameras"):
        assert after.get(key) == before.get(key), key
    old, new = (Document.parse(asset.to_bytes(), Limits(), glb=True) for asset in (source, made))
    for mesh, (was, now) in enumerate(zip(before["meshes"], after["meshes"], strict=True)):
        assert was.get("weights") == now.get("weights")
        for a, b in zip(was["primitives"], now["primitives"], strict=True):
            assert (a.get("material"), a.get("extras")) == (b.get("material"), b.get("extras")), mesh
            assert list(a["attributes"]) == list(b["attributes"])
            pairs = [(a["attributes"][name], b["attributes"][name], name) for name in a["attributes"]]
            for x, y in zip(a.get("targets", []), b.get("targets", []), strict=True):
                pairs += [(x[name], y[name], f"target {name}") for name in x]
            for one, other, name in pairs:  # the source's vertices come first, with the same numbers
                values = read_accessor(old, one)
                np.testing.assert_array_equal(read_accessor(new, other)[: len(values)], values, err_msg=name)


def test_morph_targets_move_the_middles_with_their_edges() -> None:
    builder = Builder()
    primitive = builder.primitive(SQUARE)
    primitive["targets"] = [
        {"POSITION": builder.accessor(2 * SQUARE, bounds=True)},
        {"POSITION": builder.accessor(0 * SQUARE, bounds=True)},
    ]
    builder.node(builder.mesh(primitive))
    made, _ = load_asset(builder.glb()).subdivided(MAX_TRIANGLES)
    document = Document.parse(made.to_bytes(), Limits(), glb=True)
    found = document.root["meshes"][0]["primitives"][0]
    place = read_accessor(document, found["attributes"]["POSITION"])
    np.testing.assert_allclose(read_accessor(document, found["targets"][0]["POSITION"]), 2 * place, atol=1e-6)
    assert "bufferView" not in document.root["accessors"][found["targets"][1]["POSITION"]]  # zeros take no space


@each_case("kind", [np.float32, np.uint8, np.uint16])
def test_weights_of_the_middle_are_the_mean_and_sum_to_one(kind: type) -> None:
    one = 1.0 if kind is np.float32 else np.iinfo(kind).max
    joints = np.array([[0, 1, 2, 3], [4, 5, 6, 1], [9, 0, 0, 0]], np.uint8)
    shares = np.array([[0.4, 0.3, 0.2, 0.1], [0.6, 0.15, 0.05, 0.2], [1, 0, 0, 0]])
    weights = np.round(shares * one).astype(kind) if one > 1 else shares.astype(kind)
    found = middles({"JOINTS_0": joints, "WEIGHTS_0": weights}, np.array([0, 0]), np.array([1, 2]))
    np.testing.assert_array_equal(found["JOINTS_0"], [[4, 1, 0, 2], [9, 0, 1, 2]])
    expected = np.array([[0.3, 0.25, 0.2, 0.1], [0.5, 0.2, 0.15, 0.1]])
    values = found["WEIGHTS_0"].astype(float) / one
    np.testing.assert_allclose(values, expected / expected.sum(1, keepdims=True), atol=2e-2 if one == 255 else 1e-4)
    assert found["WEIGHTS_0"].dtype == kind
    assert np.allclose(values.sum(1), 1, atol=1e-7)


def test_the_middles_of_other_attributes_have_their_type() -> None:
    columns = {
        "COLOR_0": np.array([[0, 255, 10, 255], [100, 0, 11, 255]], np.uint8),
        "TEXCOORD_1": np.array([[0, 65535], [65535, 1]], np.uint16),
        "TANGENT": np.array([[1, 0, 0, -1], [0, 1, 0, -1]], np.float32),
        "NORMAL": np.array([[0, 0, 1], [0, 0, -1]], np.float32),
        "_FEATURE_ID_0": np.array([[7], [9]], np.float32),
        "_TEMPERATURE": np.array([[7], [9]], np.float32),
    }
    found = middles(columns, np.array([0]), np.array([1]))
    assert {name: values.dtype for name, values in found.items()} == {n: v.dtype for n, v in columns.items()}
    np.testing.assert_array_equal(found["COLOR_0"], [[50, 128, 10, 255]])
    np.testing.assert_array_equal(found["TEXCOORD_1"], [[32768, 32768]])
    np.testing.assert_allclose(found["TANGENT"], [[0.5**0.5, 0.5**0.5, 0, -1]], rtol=1e-6)
    np.testing.assert_array_equal(found["NORMAL"], [[0, 0, 1]])  # opposite ones have no mean
    np.testing.assert_array_equal(found["_FEATURE_ID_0"], [[7]])  # an id, though a float
    np.testing.assert_array_equal(found["_TEMPERATURE"], [[8]])


def test_extensions_that_list_edges_are_removed_and_named() -> None:
    builder = box()
    builder.root["meshes"][0]["primitives"][0]["extensions"] = {"CESIUM_primitive_outline": {"indices": 0}}
    builder.root["extensionsUsed"] = ["CESIUM_primitive_outline"]
    made, done = load_asset(builder.glb()).subdivided(MAX_TRIANGLES)
    assert done.dropped == ("CESIUM_primitive_outline",)
    root, _, _ = unpack(made.to_bytes())
    assert "extensionsUsed" not in root
    assert "extensions" not in root["meshes"][0]["primitives"][0]
