"""The shape in a package is the asset's: corners in the world, hierarchy, normals, UVs, colours."""

from __future__ import annotations

import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pxr", reason="needs usd-core (the extra usd)")

from pxr import UsdGeom

from meshdeform.assets import build_glb, load_asset
from meshdeform.assets.usd import write_usdz
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_VERTS, Builder
from tests.unit.assets.usd.stages import COLORS, UVS, Stage, material, picture, quad, textured

TURN = [0.0, float(np.sqrt(0.5)), 0.0, float(np.sqrt(0.5))]


def test_a_stage_in_metres_with_y_up_and_one_root(tmp_path: Path) -> None:
    builder = Builder()
    builder.node(builder.mesh(quad(builder), name="sheet"), name="table")
    made = Stage(builder.glb(), tmp_path)
    assert UsdGeom.GetStageUpAxis(made.stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(made.stage) == 1.0
    assert made.stage.GetDefaultPrim().GetPath() == "/Root"
    assert [str(mesh.GetPath()) for mesh in made.meshes] == ["/Root/table/sheet"]
    assert made.meshes[0].GetSubdivisionSchemeAttr().Get() == "none"
    np.testing.assert_array_equal(made.meshes[0].GetExtentAttr().Get(), [[0, 0, 0], [1, 1, 0.5]])
    made.assert_same_shape()
    assert (made.usdz.meshes, made.usdz.left_out) == (1, [])


def test_the_same_scene_is_the_same_bytes_at_any_time_of_any_zone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    builder = Builder()
    shading = {"baseColorTexture": {"index": textured(builder, picture())}}
    builder.node(builder.mesh(quad(builder, look=material(builder, pbrMetallicRoughness=shading))))
    made = Stage(builder.glb(), tmp_path)
    with zipfile.ZipFile(made.path) as package:
        assert {info.date_time for info in package.infolist()} == {(1980, 1, 2, 0, 0, 0)}
    try:
        for zone in ("Asia/Tokyo", "America/Los_Angeles"):
            monkeypatch.setenv("TZ", zone)
            time.tzset()
            assert write_usdz(load_asset(builder.glb()).scene()).data == made.usdz.data
    finally:
        monkeypatch.undo()
        time.tzset()


def _nested() -> Builder:
    builder = Builder()
    mesh = builder.mesh(quad(builder))
    inner = builder.node(mesh, in_scene=False, translation=[1, 2, 3], scale=[2, 3, 4])
    builder.node(children=[inner], rotation=TURN, translation=[10, 0, 0])
    return builder


def _mirrored() -> Builder:
    builder = Builder()
    mesh = builder.mesh(quad(builder))
    inner = builder.node(mesh, in_scene=False, scale=[1, -2, 1], rotation=TURN)
    builder.node(children=[inner], scale=[-1, 1, 1])
    builder.node(mesh, scale=[1, 1, -3], translation=[5, 0, 0])
    return builder


def _instanced() -> Builder:
    builder = Builder()
    mesh = builder.mesh(quad(builder))
    for x in range(3):
        builder.node(mesh, translation=[x, 0, 0], name="same")
    return builder


def _quantised() -> Builder:
    builder = Builder()
    primitive = quad(builder)
    stored = np.column_stack([np.round(QUAD_VERTS * 1000), np.zeros(4)]).astype(np.int16)
    view = builder.view(stored.tobytes(), byteStride=8)
    item = {"bufferView": view, "componentType": 5122, "count": 4, "type": "VEC3", "min": [0] * 3, "max": [1000] * 3}
    builder.root["accessors"].append(item)
    primitive["attributes"]["POSITION"] = len(builder.root["accessors"]) - 1
    builder.root["extensionsRequired"] = builder.root["extensionsUsed"] = ["KHR_mesh_quantization"]
    builder.node(builder.mesh(primitive), scale=[0.001] * 3)
    return builder


def _shared() -> Builder:
    """Two primitives of one set of vertices, each with a triangle, and a strip."""
    builder = Builder()
    first = quad(builder)
    faces = [builder.accessor(QUAD_FACES[i]) for i in range(2)]
    strip = {**first, "mode": 5, "indices": builder.accessor(np.array([0, 1, 2, 3], np.uint16))}
    builder.node(builder.mesh({**first, "indices": faces[0]}, {**first, "indices": faces[1]}, strip))
    return builder


def _skinned() -> Builder:
    """The skin stands elsewhere than its node."""
    builder = Builder()
    weights = {"JOINTS_0": np.zeros((4, 4), np.uint8), "WEIGHTS_0": np.eye(4, dtype=np.float32)[[0] * 4]}
    mesh = builder.mesh(quad(builder, **weights))
    joint = builder.node(translation=[0, 7, 0])
    builder.root["skins"] = [{"joints": [joint]}]
    builder.node(mesh, skin=0, translation=[100, 0, 0], name="skinned")
    return builder


def _deep() -> Builder:
    builder = Builder()
    last = builder.node(builder.mesh(quad(builder)), in_scene=False, scale=[2, 1, 1])
    for _ in range(300):
        last = builder.node(in_scene=False, children=[last], translation=[0, 0.25, 0])
    builder.root["scenes"][0]["nodes"] = [last]
    return builder


CASES = {f.__name__: f for f in (_nested, _mirrored, _instanced, _quantised, _shared, _skinned, _deep)}


@each_case("name", CASES)
def test_corners_in_the_world_are_those_of_the_asset(name: str, tmp_path: Path) -> None:
    Stage(CASES[name]().glb(), tmp_path).assert_same_shape()


def test_a_deformed_asset_is_written_as_it_was_deformed(tmp_path: Path) -> None:
    asset = load_asset(_mirrored().glb())
    moved = asset.surface.positions * [1.0, 2.0, 0.5] + np.sin(asset.surface.positions)
    made = Stage(asset.replace(moved), tmp_path)
    made.assert_same_shape()
    np.testing.assert_allclose(made.corners(), moved[asset.surface.triangles], atol=1e-6)


def test_primitives_of_shared_vertices_take_only_their_own(tmp_path: Path) -> None:
    made = Stage(_shared().glb(), tmp_path)
    assert [len(mesh.GetPointsAttr().Get()) for mesh in made.meshes] == [3, 3, 4]


def test_normals_uvs_and_colors_are_those_of_each_point(tmp_path: Path) -> None:
    builder = Builder()
    builder.node(builder.mesh(quad(builder, COLOR_0=COLORS, TEXCOORD_1=UVS[::-1].copy())))
    made = Stage(builder.glb(), tmp_path)
    mesh = made.meshes[0]
    np.testing.assert_allclose(mesh.GetNormalsAttr().Get(), QUAD_NORMALS, atol=1e-6)
    assert mesh.GetNormalsInterpolation() == "vertex"
    np.testing.assert_allclose(made.primvar(0, "st"), UVS * [1, -1] + [0, 1], atol=1e-6)
    np.testing.assert_allclose(made.primvar(0, "st1"), UVS[::-1] * [1, -1] + [0, 1], atol=1e-6)
    np.testing.assert_allclose(made.primvar(0, "displayColor"), COLORS[:, :3], atol=1e-6)
    reader, output = made.source(made.surface(), "diffuseColor")
    assert (reader.GetInput("varname").Get(), output) == ("displayColor", "result")


def test_without_normals_each_triangle_is_flat(tmp_path: Path) -> None:
    made = Stage(build_glb(QUAD_VERTS, QUAD_FACES), tmp_path)
    mesh = made.meshes[0]
    assert mesh.GetNormalsInterpolation() == "faceVarying"
    corners = made.corners()
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.GetNormalsAttr().Get(), np.repeat(normals, 3, axis=0), atol=1e-6)


def test_names_become_valid_and_different_and_the_own_ones_are_kept(tmp_path: Path) -> None:
    builder = Builder()
    mesh = builder.mesh(quad(builder, look=material(builder, name="rød lak")), name="Würfel/1")
    for name in ("3 chairs", "3 chairs", "Materials", "", "日本", 'a"b\n'):
        builder.node(mesh, name=name)
    made = Stage(builder.glb(), tmp_path)
    nodes = [mesh.GetPrim().GetParent() for mesh in made.meshes]
    assert [node.GetName() for node in nodes] == ["_3_chairs", "_3_chairs_1", "Materials_1", "Node", "Node_1", "a_b_"]
    assert [node.GetDisplayName() for node in nodes] == ["3 chairs", "3 chairs", "Materials", "", "日本", 'a"b\n']
    assert {mesh.GetPrim().GetDisplayName() for mesh in made.meshes} == {"Würfel/1"}
    assert made.stage.GetPrimAtPath("/Root/Materials/r_d_lak").GetDisplayName() == "rød lak"
    assert len(nodes) == 6


def test_what_only_json_can_say_does_no_harm(tmp_path: Path) -> None:
    builder = Builder()
    look = material(builder, name="\ud800", emissiveFactor=[1e299, 1, 1], alphaMode="?", normalTexture={"index": 0})
    builder.root |= {"textures": [{"source": 0}], "images": [{"uri": "data:;base64,?"}]}
    builder.node(builder.mesh(quad(builder, look=look), name="half \udfff of a pair"), name="a\0b")
    made = Stage(builder.glb(), tmp_path)
    made.assert_same_shape()
    assert made.meshes[0].GetPrim().GetDisplayName() == "half ? of a pair"
    assert [item["count"] for item in made.usdz.left_out] == [1]


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    builder = _skinned()
    root = builder.root
    root["meshes"][0]["primitives"].append({**quad(builder), "mode": 1})
    root["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": builder.accessor(QUAD_VERTS)}]
    root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]
    root["animations"] = [{"channels": [], "samplers": []}] * 2
    root["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = builder.accessor(np.ones((3, 4), np.float32))
    root["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    builder.node(builder.mesh(quad(builder)), extensions={"EXT_mesh_gpu_instancing": {"attributes": {}}})
    made = Stage(builder.glb(), tmp_path)
    said: dict[str, Any] = {item["what"]: item for item in made.usdz.left_out}
    assert {what: item["count"] for what, item in said.items()} == {
        "animations": 2,
        "cameras": 1,
        "lines": 1,
        "morph targets": 1,
        "skins": 1,
        "invalid COLOR_0": 1,
        "EXT_mesh_gpu_instancing": 1,
    }
    assert said["skins"]["instead"] == "the bind pose, deformed"
    assert len(made.meshes) == 1
