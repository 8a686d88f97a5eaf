"""The surface in the world: hierarchy, mirrors, instances, skins, scenes, and every way to store an accessor."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.assets.accessors import triangle_list
from meshdeform.errors import AssetEmptyError, AssetError, AssetNotFiniteError
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_TANGENTS, QUAD_VERTS, Builder, quad


def test_a_plain_quad() -> None:
    surface = load_asset(quad()).surface
    np.testing.assert_array_equal(surface.positions, QUAD_VERTS)
    np.testing.assert_array_equal(surface.triangles, QUAD_FACES)
    np.testing.assert_allclose(surface.normals, QUAD_NORMALS, atol=1e-7)
    np.testing.assert_allclose(surface.tangents, QUAD_TANGENTS, atol=1e-7)
    assert surface.positions.dtype == surface.normals.dtype == np.float64
    assert surface.triangles.dtype == np.int64
    assert surface.skipped == []


def test_transforms_multiply_down_the_hierarchy() -> None:
    builder = Builder()
    child = builder.node(builder.mesh(builder.primitive()), in_scene=False, translation=[1, 2, 3], scale=[2, 3, 4])
    turn = [0, np.sqrt(0.5), 0, np.sqrt(0.5)]  # a quarter turn about y: x -> -z, z -> x
    builder.node(children=[child], rotation=turn, translation=[10, 0, 0])
    expected = QUAD_VERTS * [2.0, 3.0, 4.0] + [1.0, 2.0, 3.0]
    expected = np.stack([expected[:, 2] + 10, expected[:, 1], -expected[:, 0]], axis=1)
    np.testing.assert_allclose(load_asset(builder.glb()).surface.positions, expected, atol=1e-6)


def test_a_matrix_is_stored_by_columns() -> None:
    matrix = [2, 0, 0, 0, 0, 3, 0, 0, 0, 0, 4, 0, 5, 6, 7, 1]
    surface = load_asset(quad(matrix=matrix)).surface
    np.testing.assert_array_equal(surface.positions, QUAD_VERTS * [2.0, 3.0, 4.0] + [5.0, 6.0, 7.0])


@each_case("scale", [[-1, 1, 1], [2, -3, 4], [-1, -1, -1]])
def test_a_mirror_turns_the_winding_and_the_handedness(scale: list[float]) -> None:
    surface = load_asset(quad(scale=scale)).surface
    a, b, c = (surface.positions[surface.triangles[0, i]] for i in range(3))
    outward = np.cross(b - a, c - a)
    assert outward @ surface.normals[0] > 0  # the normal went through the inverse transpose
    bitangent = np.cross(surface.normals, surface.tangents[:, :3]) * surface.tangents[:, 3:]
    local = np.cross(QUAD_NORMALS, QUAD_TANGENTS[:, :3]) * QUAD_TANGENTS[:, 3:]
    assert (np.einsum("ij,ij->i", bitangent, local * scale) > 0).all()


def test_instances_are_separate_vertices_with_their_own_number() -> None:
    builder = Builder()
    mesh = builder.mesh(builder.primitive())
    builder.node(mesh)
    builder.node(mesh, translation=[5, 0, 0])
    surface = load_asset(builder.glb()).surface
    np.testing.assert_array_equal(surface.positions, np.vstack([QUAD_VERTS, QUAD_VERTS + [5.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(surface.triangles, np.vstack([QUAD_FACES, QUAD_FACES + 4]))
    assert surface.instance_of_vertex.tolist() == [0] * 4 + [1] * 4


def test_primitives_that_share_accessors_share_vertices() -> None:
    builder = Builder()
    first = builder.primitive(faces=QUAD_FACES[:1])
    second = {**first, "indices": builder.accessor(QUAD_FACES[1])}
    builder.node(builder.mesh(first, second))
    surface = load_asset(builder.glb()).surface
    assert len(surface.positions) == 4
    np.testing.assert_array_equal(surface.triangles, QUAD_FACES)


def test_only_the_default_scene_is_read_and_without_scenes_every_root_node() -> None:
    builder = Builder()
    builder.node(builder.mesh(builder.primitive()))
    other = builder.node(builder.mesh(builder.primitive(QUAD_VERTS + 7)), in_scene=False)
    builder.root["scenes"].append({"nodes": [other]})
    np.testing.assert_array_equal(load_asset(builder.glb()).surface.positions, QUAD_VERTS)
    builder.root["scene"] = 1
    np.testing.assert_array_equal(load_asset(builder.glb()).surface.positions, QUAD_VERTS + 7)
    del builder.root["scenes"], builder.root["scene"]
    assert len(load_asset(builder.glb()).surface.positions) == 8


def test_flattened_meshes_are_listed_as_skipped_and_points_are_not() -> None:
    builder = Builder()
    points = {**builder.primitive(), "mode": 0}
    builder.node(builder.mesh(builder.primitive(), points))
    builder.node(0, scale=[1, 0, 1])
    surface = load_asset(builder.glb()).surface
    assert len(surface.positions) == 4
    reasons = [item["reason"] for item in surface.skipped]
    assert len(reasons) == 1
    assert "inverted" in reasons[0]


def test_a_skin_places_its_mesh_by_the_joints_and_not_by_its_node() -> None:
    builder = Builder()
    joint = builder.node(translation=[0, 10, 0])
    inverse_bind = np.eye(4, dtype=np.float32)
    inverse_bind[3, :3] = [1, -10, 0]  # column-major: the translation is the last row
    builder.root["skins"] = [{"joints": [joint], "inverseBindMatrices": builder.accessor(inverse_bind.reshape(1, 16))}]
    joints, weights = np.zeros((4, 4), np.uint8), np.eye(4, dtype=np.float32)[[0] * 4]
    builder.node(builder.mesh(builder.primitive(JOINTS_0=joints, WEIGHTS_0=weights)), skin=0, translation=[99, 0, 0])
    np.testing.assert_allclose(load_asset(builder.glb()).surface.positions, QUAD_VERTS + [1.0, 0.0, 0.0], atol=1e-6)
    posed = Builder()  # by the joint that agrees with most
    posed.root["skins"] = [{"joints": [posed.node(translation=[0, y, 0]) for y in (0, 0, 0, 5)]}]
    posed.node(posed.mesh(posed.primitive()), skin=0)
    np.testing.assert_array_equal(load_asset(posed.glb()).surface.positions, QUAD_VERTS)


def test_interleaved_views() -> None:
    builder = Builder()
    rows = np.hstack([QUAD_NORMALS, QUAD_VERTS]).astype(np.float32)
    view = builder.view(rows.tobytes(), byteStride=24)
    base = {"bufferView": view, "componentType": 5126, "count": 4, "type": "VEC3"}
    builder.root["accessors"] += [{**base, "byteOffset": 12}, base]
    builder.node(
        builder.mesh({"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": builder.accessor(QUAD_FACES.reshape(-1))})
    )
    surface = load_asset(builder.glb()).surface
    np.testing.assert_array_equal(surface.positions, QUAD_VERTS)
    np.testing.assert_allclose(surface.normals, QUAD_NORMALS, atol=1e-7)


@each_case("with_base", [True, False])
def test_sparse_accessors(with_base: bool) -> None:
    builder = Builder()
    primitive = builder.primitive(np.zeros((4, 3)))
    accessor = builder.root["accessors"][primitive["attributes"]["POSITION"]]
    if not with_base:
        del accessor["bufferView"]
    accessor["sparse"] = {
        "count": 3,
        "indices": {"bufferView": builder.view(np.array([1, 2, 3], np.uint16).tobytes()), "componentType": 5123},
        "values": {"bufferView": builder.view(QUAD_VERTS[1:].tobytes())},
    }
    builder.node(builder.mesh(primitive))
    np.testing.assert_array_equal(load_asset(builder.glb()).surface.positions, QUAD_VERTS)


@each_case(
    ("dtype", "normalized", "scale"),
    [
        (np.int8, True, 127),
        (np.int16, True, 32767),
        (np.uint16, False, 1),
    ],
)
def test_quantized_positions(dtype: Any, normalized: bool, scale: int) -> None:
    builder = Builder()
    stored = np.zeros((4, 4), dtype)  # a row of three components is padded to four bytes
    stored[:, :3] = (QUAD_VERTS * min(scale, 100)).astype(dtype)
    view = builder.view(stored.tobytes(), byteStride=4 * stored.itemsize)
    component = {1: 5120, 2: 5122}[stored.itemsize] + (stored.dtype.kind == "u")
    builder.root["accessors"].append(
        {"bufferView": view, "componentType": component, "count": 4, "type": "VEC3", "normalized": normalized}
    )
    builder.root |= {key: ["KHR_mesh_quantization"] for key in ("extensionsUsed", "extensionsRequired")}
    builder.node(builder.mesh({"attributes": {"POSITION": 0}, "indices": builder.accessor(QUAD_FACES.reshape(-1))}))
    surface = load_asset(builder.glb()).surface
    np.testing.assert_allclose(surface.positions, stored[:, :3].astype(float) / scale, rtol=1e-7)


def test_what_has_no_surface_is_told() -> None:
    for bad in (np.nan, np.inf, -np.inf):
        verts = QUAD_VERTS.copy()
        verts[2, 1] = bad
        builder = Builder()
        primitive = builder.primitive()
        primitive["attributes"]["POSITION"] = builder.accessor(verts)
        builder.node(builder.mesh(primitive))
        with pytest.raises(AssetNotFiniteError, match="1 positions"):
            load_asset(builder.glb())
    builder = Builder()
    builder.node(builder.mesh(builder.primitive(faces=np.array([0, 1, 4], np.uint16))))
    with pytest.raises(AssetError, match="vertex 4"):
        load_asset(builder.glb())
    for mode in (0, 1, 2, 3):
        builder.root["meshes"][0]["primitives"][0]["mode"] = mode
        with pytest.raises(AssetEmptyError, match="only follow a surface"):
            load_asset(builder.glb())


@each_case(
    ("corners", "mode", "restart", "triangles"),
    [
        # A list keeps its degenerate triangles, and drops what is left over.
        ([0, 1, 2, 2, 2, 3, 9], 4, None, [[0, 1, 2], [2, 2, 3]]),
        # Every second triangle of a strip is turned, also of one that repeated corners stitch.
        ([0, 1, 2, 3, 4], 5, None, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]),
        ([0, 1, 2, 3, 3, 4, 4, 5, 6], 5, None, [[0, 1, 2], [1, 3, 2], [4, 5, 6]]),
        ([0, 1, 2, 3], 6, None, [[1, 2, 0], [2, 3, 0]]),
        ([0, 1, 2, 255, 3, 4, 5, 6, 255, 7], 5, 255, [[0, 1, 2], [3, 4, 5], [4, 6, 5]]),
        ([0, 1, 2, 255, 3, 4, 5], 6, 255, [[1, 2, 0], [4, 5, 3]]),
        *[([0, 1], mode, None, []) for mode in (4, 5, 6)],
    ],
)
def test_lists_strips_and_fans_make_the_triangles_that_the_specification_lists(
    corners: list[int], mode: int, restart: int | None, triangles: list[list[int]]
) -> None:
    assert triangle_list(np.array(corners, np.int64), mode, restart).tolist() == triangles
    builder = Builder()
    builder.node(builder.mesh({**builder.primitive(QUAD_VERTS[[0, 1, 2, 3] * 3], np.uint8(corners)), "mode": mode}))
    if restart is None and triangles:
        assert load_asset(builder.glb()).surface.triangles.tolist() == triangles


@each_case("dtype", [np.uint8, np.uint16, np.uint32, None])
def test_every_index_type(dtype: Any) -> None:
    builder = Builder()
    verts, faces = (QUAD_VERTS[:3], None) if dtype is None else (QUAD_VERTS, QUAD_FACES.astype(dtype))
    builder.node(builder.mesh(builder.primitive(verts, faces)))
    surface = load_asset(builder.glb()).surface
    np.testing.assert_array_equal(surface.triangles, [[0, 1, 2]] if faces is None else QUAD_FACES)
    assert np.isnan(surface.normals).all()
    assert np.isnan(surface.tangents).all()
