"""Poses baked into a file: vertices worked out by hand, and those of a player written without the code under test."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.assets.export import Export, export
from meshdeform.assets.pose import Pose
from meshdeform.errors import MeshdeformError, ParameterError
from tests.cases import each_case
from tests.unit.assets.builders import Builder, unpack
from tests.unit.assets.playing import Player
from tests.unit.assets.test_rig import arm

HALF = np.sqrt(0.5)


def two_joints(mode: str = "LINEAR", **node: Any) -> Builder:
    """A triangle on two joints, the second one unit along +X: from 0 to 2 s it turns a quarter about +Z."""
    builder = Builder()
    verts = np.array([[1, 0, 0], [2, 0, 0], [1, 1, 0]], np.float32)
    joints = np.array([[0, 1, 0, 0]] * 3, np.uint8)
    weights = np.array([[0.25, 0.75, 0, 0], [0, 1, 0, 0], [1, 0, 0, 0]], np.float32)
    normals = np.array([[0, 1, 0]] * 3, np.float32)
    primitive = builder.primitive(
        verts, np.array([0, 1, 2], np.uint16), NORMAL=normals, JOINTS_0=joints, WEIGHTS_0=weights
    )
    skinned = builder.node(builder.mesh(primitive), skin=0, **node)
    second = builder.node(in_scene=False, name="second", translation=[1, 0, 0])
    first = builder.node(name="first", children=[second])
    binds = np.stack([np.eye(4, dtype=np.float32)] * 2)
    binds[1, 3, 0] = -1
    matrices = builder.accessor(binds.reshape(2, 16))
    builder.root["skins"] = [{"joints": [first, second], "inverseBindMatrices": matrices, "skeleton": first}]
    times = builder.accessor(np.array([0, 2], np.float32), bounds=True)
    turns = builder.accessor(np.array([[0, 0, 0, 1], [0, 0, HALF, HALF]], np.float32))
    sampler = {"input": times, "output": turns, "interpolation": mode}
    channel = {"sampler": 0, "target": {"node": second, "path": "rotation"}}
    builder.root["animations"] = [{"name": "bend", "samplers": [sampler], "channels": [channel]}]
    assert skinned == 0
    return builder


def posed(glb: bytes, pose: str) -> Export:
    return export(load_asset(glb), "posed.glb", pose=Pose.parse(pose))


def positions(glb: bytes) -> NDArray[np.float64]:
    return load_asset(glb).surface.positions


@each_case("node", [{}, {"translation": [3, 4, 5], "scale": [2, 2, 2]}, {"scale": [0, 0, 0]}])
def test_a_skinned_vertex_is_where_it_is_worked_out_to_be(node: dict[str, Any]) -> None:
    # After 2 s the second joint's (x, y) relative to (1, 0) become (-y, x); after 1 s they turn by 45 degrees.
    glb = two_joints(**node).glb()
    end = posed(glb, "bend@2")
    np.testing.assert_allclose(positions(end.data), [[1, 0, 0], [1, 1, 0], [1, 1, 0]], atol=1e-6)
    middle = posed(glb, "0@1")
    np.testing.assert_allclose(positions(middle.data)[1], [1 + HALF, HALF, 0], atol=1e-6)
    normals = load_asset(middle.data).surface.normals
    np.testing.assert_allclose(normals[1], [-HALF, HALF, 0], atol=1e-6)
    np.testing.assert_allclose(normals[2], [0, 1, 0], atol=1e-6)
    root, _, _ = unpack(end.data)
    assert not {"skins", "animations"} & root.keys()
    attributes = root["meshes"][0]["primitives"][0]["attributes"]
    assert attributes.keys() == {"POSITION", "NORMAL"}
    assert all("skin" not in node for node in root["nodes"])
    assert {"first", "second"} <= {node.get("name") for node in root["nodes"]}
    assert end.warnings == ("Without animations.", "Without skins.")
    assert len(end.data) < len(glb)


def test_a_step_stays_until_its_end_and_a_curve_is_cubic() -> None:
    assert positions(posed(two_joints("STEP").glb(), "0@1.99").data)[1] == pytest.approx([2, 0, 0])
    builder = two_joints()
    times = builder.accessor(np.array([0, 2], np.float32), bounds=True)
    # In-tangent, value, out-tangent. With zero tangents a curve is 3t^2 - 2t^3: at a quarter 0.15625 of the way.
    still = np.zeros((2, 3, 3), np.float32)
    still[0, 1], still[1, 1] = [1, 0, 0], [1, 0, 8]
    output = builder.accessor(still.reshape(-1, 3))
    animation = builder.root["animations"][0]
    animation["samplers"] = [{"input": times, "output": output, "interpolation": "CUBICSPLINE"}]
    animation["channels"] = [{"sampler": 0, "target": {"node": 1, "path": "translation"}}]
    np.testing.assert_allclose(positions(posed(builder.glb(), "bend@0.5").data)[1], [2, 0, 8 * 0.15625], atol=1e-6)


@each_case("targets", [False, True])
def test_an_arm_with_curves_and_targets_is_where_a_player_has_it(targets: bool) -> None:
    glb = arm(targets=targets).glb()
    for seconds in (0.0, 1.0):  # between keys the player does not know curves
        baked = posed(glb, f"0@{seconds}").data
        player, again = Player(glb), Player(baked)
        for node, item in enumerate(player.root["nodes"]):
            if "mesh" in item:
                np.testing.assert_allclose(again.at(None, node).verts, player.at(seconds, node).verts, atol=2e-6)


def test_targets_are_added_with_the_weights_of_the_moment() -> None:
    builder = Builder()
    primitive = builder.primitive(NORMAL=np.array([[0, 0, 1]] * 4, np.float32))
    moves = np.array([[0, 0, 1]] * 4, np.float32)
    primitive["targets"] = [{"POSITION": builder.accessor(moves, bounds=True)}]
    mesh = builder.mesh(primitive, weights=[0.5], extras={"targetNames": ["up"]})
    builder.node(mesh)
    builder.node(mesh, translation=[5, 0, 0], weights=[0.0])
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    weights = builder.accessor(np.array([0, 4], np.float32))
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    pointed = {"sampler": 0, "target": {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/x"}}}}
    sampler = {"input": times, "output": weights}
    builder.root["animations"] = [{"samplers": [sampler], "channels": [channel, pointed]}]
    builder.root["extensionsUsed"] = ["KHR_animation_pointer"]
    made = posed(builder.glb(), "0@0.25")
    found = positions(made.data)
    source = positions(builder.glb())
    np.testing.assert_allclose(found[:4] - source[:4], [[0, 0, 0.5]] * 4, atol=1e-6)  # 1.0, and 0.5 at rest
    np.testing.assert_array_equal(found[4:], source[4:])
    root, _, _ = unpack(made.data)
    assert len(root["meshes"]) == 2
    assert not any({"weights", "extras", "targets"} & {*mesh, *mesh["primitives"][0]} for mesh in root["meshes"])
    assert not any("weights" in node for node in root["nodes"])
    assert "extensionsUsed" not in root
    assert "Without what the clip does to other things than nodes and weights." in made.warnings
    assert "KHR_animation_pointer" not in json.dumps(root)


@each_case(
    ("pose", "said"),
    [
        ("bend", "CLIP@SECONDS"),
        ("@1", "CLIP@SECONDS"),
        ("bend@soon", "CLIP@SECONDS"),
        ("bend@nan", "CLIP@SECONDS"),
        ("walk@1", "0 bend"),
        ("1@1", "0 bend"),
        ("bend@2.1", "from 0 to 2 s"),
        ("bend@-1", "from 0 to 2 s"),
    ],
)
def test_a_pose_that_there_is_not_is_refused(pose: str, said: str) -> None:
    with pytest.raises(ParameterError) as caught:
        posed(two_joints().glb(), pose)
    assert said in f"{caught.value} {caught.value.advice_text}"


def test_names_of_clips_may_hold_anything_and_be_the_same() -> None:
    builder = two_joints()
    (animation,) = builder.root["animations"]
    builder.root["animations"] = [{**animation, "name": "run@1"}, {**animation, "name": "1"}, animation, animation]
    glb = builder.glb()
    assert positions(posed(glb, "run@1@2").data)[1] == pytest.approx([1, 1, 0], abs=1e-6)
    assert posed(glb, "1@2").data == posed(glb, "2@2").data == posed(glb, "3@2").data
    with pytest.raises(ParameterError, match="2 clips"):
        posed(glb, "bend@1")
    del builder.root["animations"]
    with pytest.raises(ParameterError, match="no animations"):
        posed(builder.glb(), "bend@1")


def test_channels_that_are_not_valid_are_passed_over() -> None:
    broken: list[Any] = [
        None,
        {},
        {"sampler": 9, "target": {"node": 1, "path": "rotation"}},
        {"sampler": 0, "target": {"node": 99, "path": "rotation"}},
        {"sampler": 0, "target": {"node": 1, "path": "translation"}},
        {"sampler": 0, "target": {"node": "x", "path": "rotation"}},
    ]
    builder = two_joints()
    builder.root["animations"][0]["channels"] += broken
    made = posed(builder.glb(), "bend@2")
    np.testing.assert_allclose(positions(made.data)[1], [1, 1, 0], atol=1e-6)
    assert f"Without what the clip does to other things than nodes and weights: {len(broken)}." in made.warnings
    builder.root["animations"] = "none"
    with pytest.raises(MeshdeformError):
        posed(builder.glb(), "bend@2")
