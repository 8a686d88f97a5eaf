"""The deformation as one more morph target: the base stays, weights and animations grow with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshdeform.assets import load_asset
from tests.unit.assets.builders import QUAD_NORMALS, QUAD_TANGENTS, QUAD_VERTS, Builder, quad, unpack
from tests.unit.assets.test_replace import accessor, position


def morphed(builder: Builder, scale: float = 2.0) -> tuple[dict[str, Any], bytes, bytes]:
    asset = load_asset(builder.glb())
    surface = asset.surface
    written = asset.replace(surface.positions * scale, -surface.normals, surface.tangents, morph=True)
    root, binary, _ = unpack(written)
    return root, binary, written


def values(root: dict[str, Any], binary: bytes, at: int) -> list[float]:
    return accessor(root, binary, at).reshape(-1).tolist()


def test_the_base_stays_and_an_animation_goes_to_the_new_shape() -> None:
    asset = load_asset(quad())
    surface = asset.surface
    tangents = surface.tangents * [-1, -1, -1, 1]
    written = asset.replace(surface.positions * 3, -surface.normals, tangents, morph=True)
    root, binary, _ = unpack(written)
    np.testing.assert_array_equal(position(written), QUAD_VERTS)
    (target,) = root["meshes"][0]["primitives"][0]["targets"]
    np.testing.assert_array_equal(QUAD_VERTS + accessor(root, binary, target["POSITION"]), QUAD_VERTS * 3)
    np.testing.assert_allclose(QUAD_NORMALS + accessor(root, binary, target["NORMAL"]), -QUAD_NORMALS, atol=1e-6)
    delta = accessor(root, binary, target["TANGENT"])
    assert delta.shape == (4, 3)
    np.testing.assert_allclose(QUAD_TANGENTS[:, :3] + delta, -QUAD_TANGENTS[:, :3], atol=1e-6)
    assert root["meshes"][0]["weights"] == [1.0]
    assert root["meshes"][0]["extras"] == {"targetNames": ["deform"]}
    item = root["accessors"][target["POSITION"]]
    assert item["max"] == accessor(root, binary, target["POSITION"]).max(axis=0).tolist()
    (animation,) = root["animations"]
    assert animation["name"] == "deform"
    assert animation["channels"] == [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]
    (sampler,) = animation["samplers"]
    assert sampler["interpolation"] == "LINEAR"
    assert values(root, binary, sampler["input"]) == [0.0, 1.0]
    assert root["accessors"][sampler["input"]]["max"] == [1.0]
    assert values(root, binary, sampler["output"]) == [0.0, 1.0]


def with_targets(count: int) -> Builder:
    builder = Builder()
    primitive = builder.primitive(NORMAL=QUAD_NORMALS)
    deltas = [builder.accessor(QUAD_VERTS * (i + 1), bounds=True) for i in range(count)]
    primitive["targets"] = [{"POSITION": delta} for delta in deltas]
    builder.mesh(primitive, weights=[0.25] * count, extras={"targetNames": [f"t{i}" for i in range(count)], "k": 1})
    return builder


def test_existing_targets_keep_their_places() -> None:
    builder = with_targets(2)
    builder.node(0, weights=[0.5, 0.125])
    old = [dict(target) for target in builder.root["meshes"][0]["primitives"][0]["targets"]]
    root, binary, _ = morphed(builder)
    mesh = root["meshes"][0]
    assert mesh["primitives"][0]["targets"][:2] == old
    assert len(mesh["primitives"][0]["targets"]) == 3
    assert mesh["weights"] == [0.25, 0.25, 1.0]
    assert mesh["extras"] == {"targetNames": ["t0", "t1", "deform"], "k": 1}
    assert root["nodes"][0]["weights"] == [0.5, 0.125, 1.0]
    output = root["animations"][0]["samplers"][0]["output"]
    assert values(root, binary, output) == [0.5, 0.125, 0.0, 0.5, 0.125, 1.0]


def test_every_primitive_has_as_many_targets() -> None:
    builder = with_targets(1)
    mesh = builder.root["meshes"][0]
    mesh["primitives"].append({**builder.primitive(QUAD_VERTS + 5), "mode": 0})
    mesh["primitives"].append(builder.primitive(QUAD_VERTS + 9))
    builder.node(0)
    root, binary, _ = morphed(builder)
    first, points, third = root["meshes"][0]["primitives"]
    assert [len(p["targets"]) for p in (first, points, third)] == [2, 2, 2]
    for zero in (points["targets"][0], third["targets"][0]):
        item = root["accessors"][zero["POSITION"]]
        assert item["count"] == 4
        assert "bufferView" not in item  # zeros by definition
        assert item["max"] == [0.0, 0.0, 0.0]
    moved = accessor(root, binary, third["targets"][1]["POSITION"])
    np.testing.assert_array_equal(moved, QUAD_VERTS + 9)


def test_existing_animations_of_the_weights_get_a_column() -> None:
    builder = with_targets(2)
    node = builder.node(0)
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    linear = builder.accessor(np.array([0, 0.5, 1, 0.25], np.float32))
    cubic = builder.accessor(np.arange(12, dtype=np.float32))
    normalized = builder.accessor(np.array([0, 255, 51, 102], np.uint8), normalized=True)
    samplers = [
        {"input": times, "output": linear},
        {"input": times, "output": cubic, "interpolation": "CUBICSPLINE"},
        {"input": times, "output": normalized, "interpolation": "STEP"},
    ]
    channels = [{"sampler": i, "target": {"node": node, "path": "weights"}} for i in range(3)]
    pointer = {"pointer": "/meshes/0/weights"}
    channels.append({"sampler": 0, "target": {"path": "pointer", "extensions": {"KHR_animation_pointer": pointer}}})
    channels.append({"sampler": 0, "target": {"node": node, "path": "translation"}})  # nonsense, but not ours
    builder.root["animations"] = [{"samplers": samplers, "channels": channels}]
    root, binary, _ = morphed(builder)
    animation = root["animations"][0]
    assert animation["samplers"][:3] == samplers
    outputs = [animation["samplers"][channel["sampler"]]["output"] for channel in animation["channels"]]
    assert values(root, binary, outputs[0]) == [0, 0.5, 1, 1, 0.25, 1]
    assert values(root, binary, outputs[1]) == [0, 1, 0, 2, 3, 1, 4, 5, 0, 6, 7, 0, 8, 9, 1, 10, 11, 0]
    np.testing.assert_allclose(values(root, binary, outputs[2]), [0, 1, 1, 0.2, 0.4, 1])
    assert animation["samplers"][animation["channels"][2]["sampler"]]["interpolation"] == "STEP"
    assert outputs[3] == outputs[0]
    assert outputs[4] == linear
    assert root["animations"][1]["name"] == "deform"


def test_instances_morph_each_on_its_own() -> None:
    builder = Builder()
    mesh = builder.mesh(builder.primitive())
    builder.node(mesh)
    builder.node(mesh, translation=[5, 0, 0])
    asset = load_asset(builder.glb())
    moved = asset.surface.positions + np.repeat([[0.0, 1, 0], [0, 2, 0]], 4, axis=0)
    root, binary, _ = unpack(asset.replace(moved, morph=True))
    assert [node["mesh"] for node in root["nodes"]] == [0, 1]
    for i, y in enumerate((1, 2)):
        target = root["meshes"][i]["primitives"][0]["targets"][0]["POSITION"]
        np.testing.assert_array_equal(accessor(root, binary, target), [[0, y, 0]] * 4)
    assert [channel["target"]["node"] for channel in root["animations"][0]["channels"]] == [0, 1]


def test_a_morphed_asset_can_be_deformed_again() -> None:
    builder = with_targets(1)
    builder.node(0)
    _, _, written = morphed(builder)
    again = load_asset(written)
    np.testing.assert_array_equal(again.surface.positions, QUAD_VERTS * 2.5)  # the result, as viewers show it
    root, _, _ = unpack(again.replace(again.surface.positions * 2, again.surface.normals, morph=True))
    assert len(root["meshes"][0]["weights"]) == 3
    assert [animation["name"] for animation in root["animations"]] == ["deform", "deform"]
