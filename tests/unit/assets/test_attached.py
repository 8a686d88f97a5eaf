"""Nodes without a skin that go where the surface around them goes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from tests.cases import each_case
from tests.unit.assets.builders import Builder
from tests.unit.assets.playing import Player
from tests.unit.assets.test_rig import arm, hat_of
from training.shapes import box

Floats = NDArray[np.float64]
TURN = [0.0, 0.0, 0.70710678, 0.70710678]
BALL, BOX = icosphere(2), TriangleMesh(2 * box(3).verts, box(3).faces)


def part(builder: Builder, mesh: Any, **node: Any) -> int:
    """Add a node with a mesh to the builder's hierarchy."""
    return builder.node(builder.mesh(builder.primitive(mesh.verts, mesh.faces.astype(np.uint16))), **node)


def car() -> tuple[Builder, dict[str, int]]:
    """A body at the origin of the scene with two turning wheels, a door, a light in it and things that stay."""
    builder, names = Builder(), dict[str, int]()
    light = {"extensions": {"KHR_lights_punctual": {"light": 0}}}
    sun = {"extensions": {"KHR_lights_punctual": {"light": 1}}}
    names["hub"] = builder.node(in_scene=False, translation=[0.1, 0, 0])
    names["wheel"] = part(
        builder, BALL, in_scene=False, translation=[2, -1, 0], scale=[0.5] * 3, rotation=TURN, children=[names["hub"]]
    )
    names["light"] = builder.node(in_scene=False, translation=[0.2, 0.3, 0.1], **light)
    names["far"] = builder.node(in_scene=False, translation=[9, 9, 9])
    names["body"] = part(builder, BOX, children=[names["wheel"], names["light"], names["far"]])
    names["door"] = part(builder, BOX, translation=[0, 0, 3])
    names["camera"] = builder.node(camera=0, translation=[0, 0, 0.2])
    names["sun"] = builder.node(translation=[0, 0.1, 0], **sun)
    names["socket"] = builder.node(translation=[0.0, 1.01, 0.0])
    builder.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]
    builder.root["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}, {"type": "directional"}]}}
    builder.root["extensionsUsed"] = ["KHR_lights_punctual"]
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    turn = builder.accessor(np.array([[0, 0, 0, 1], TURN], np.float32))
    slide = builder.accessor(np.array([[0, 0, 3], [0, 0, 4]], np.float32))
    builder.root["animations"] = [
        {
            "samplers": [{"input": times, "output": turn}, {"input": times, "output": slide}],
            "channels": [
                {"sampler": 0, "target": {"node": names["wheel"], "path": "rotation"}},
                {"sampler": 1, "target": {"node": names["door"], "path": "translation"}},
            ],
        }
    ]
    return builder, names


def moved(glb: bytes, linear: Floats, shift: Floats, *, follows: bool = True) -> bytes:
    """The asset after an affine map."""
    asset = load_asset(glb)
    positions = asset.surface.positions @ linear.T + shift
    jacobians = np.tile(linear, (len(positions), 1, 1)) if follows else None
    return asset.replace(positions, jacobians=jacobians)


def origins(glb: bytes) -> Floats:
    return np.stack([world[:3, 3] for world in Player(glb).worlds(None)])


LINEAR, SHIFT = np.array([[1.5, 0.2, 0.0], [0.0, 0.75, 0.0], [0.0, 0.1, 2.0]]), np.array([0.3, -0.2, 0.5])


def test_what_hangs_on_the_surface_goes_where_the_surface_goes_and_the_rest_stays() -> None:
    builder, names = car()
    before, after = origins(builder.glb()), origins(moved(builder.glb(), LINEAR, SHIFT))
    for name in ("wheel", "door", "light", "socket"):
        np.testing.assert_allclose(after[names[name]], LINEAR @ before[names[name]] + SHIFT, atol=1e-6, err_msg=name)
    for name in ("body", "camera", "sun", "far"):
        np.testing.assert_allclose(after[names[name]], before[names[name]], atol=1e-9, err_msg=name)
    # A hub within the wheel, too: it is a place of its own.
    np.testing.assert_allclose(after[names["hub"]], LINEAR @ before[names["hub"]] + SHIFT, atol=1e-6)


def test_the_surface_is_where_it_was_put_whatever_its_nodes_do() -> None:
    builder, _ = car()
    before = load_asset(builder.glb()).surface
    after = load_asset(moved(builder.glb(), LINEAR, SHIFT)).surface
    np.testing.assert_allclose(after.positions, before.positions @ LINEAR.T + SHIFT, atol=1e-6)
    np.testing.assert_array_equal(after.triangles, before.triangles)


def test_a_wheel_still_turns_about_its_centre_and_a_door_slides_as_far_as_it_has_grown() -> None:
    builder, names = car()
    player = Player(moved(builder.glb(), 2 * np.eye(3), np.zeros(3)))
    for time in (0.0, 0.3, 1.0):
        rim = player.at(time, names["wheel"]).verts
        np.testing.assert_allclose(rim.min(0) + rim.max(0), 2 * np.array([4.0, -2.0, 0.0]), atol=0.05)
    slides = [player.worlds(time)[names["door"]][:3, 3] for time in (0.0, 1.0)]
    np.testing.assert_allclose(slides, [[0, 0, 6], [0, 0, 8]], atol=1e-6)


def test_nothing_moves_if_it_is_to_be_kept() -> None:
    builder, _ = car()
    kept = Player(moved(builder.glb(), LINEAR, SHIFT, follows=False))
    assert kept.root["nodes"] == Player(builder.glb()).root["nodes"]


@each_case("animated", [False, True])
def test_the_node_of_a_whole_asset_stays_unless_it_is_animated(animated: bool) -> None:
    builder = Builder()
    node = part(builder, BALL, translation=[3, 0, 1], scale=[2, 2, 2])
    if animated:
        times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
        turn = builder.accessor(np.array([[0, 0, 0, 1], TURN], np.float32))
        channel = {"sampler": 0, "target": {"node": node, "path": "rotation"}}
        builder.root["animations"] = [{"samplers": [{"input": times, "output": turn}], "channels": [channel]}]
    before, after = origins(builder.glb())[node], origins(moved(builder.glb(), LINEAR, SHIFT))[node]
    np.testing.assert_allclose(after, LINEAR @ before + SHIFT if animated else before, atol=1e-6)


def test_a_mesh_on_a_bone_stays_on_the_surface_and_what_hangs_on_the_bone_goes_with_it() -> None:
    builder = arm()
    socket = builder.node(in_scene=False, translation=[0.0, 5.0, 0.0])
    last = builder.root["skins"][0]["joints"][-1]
    builder.root["nodes"][last]["children"].append(socket)
    hat = hat_of(Player(builder.glb()))
    before, result = origins(builder.glb()), moved(builder.glb(), 1.5 * np.eye(3), SHIFT)
    after = origins(result)
    np.testing.assert_allclose(after[hat], 1.5 * before[hat] + SHIFT, atol=1e-5)
    np.testing.assert_allclose(after[socket] - after[last], before[socket] - before[last], atol=1e-6)
    # It turns with its bone, as it did.
    turned = [Player(glb).worlds(1.0) for glb in (builder.glb(), result)]
    np.testing.assert_allclose(turned[1][hat][:3, :3], turned[0][hat][:3, :3], atol=1e-9)


@pytest.mark.parametrize("height", [0.97, 1.0, 1.03, 1.2])
def test_near_is_two_percent_of_the_diagonal(height: float) -> None:
    builder, mesh = Builder(), BOX
    part(builder, mesh)
    lamp = builder.node(translation=[0.1, height, 0.2])
    after = origins(moved(builder.glb(), np.diag([1.0, 2.0, 1.0]), np.zeros(3)))[lamp]
    hangs = height < 1.0 + 0.02 * float(np.linalg.norm(np.ptp(mesh.verts, axis=0)))
    assert after[1] == pytest.approx(2 * height if hangs else height)


def test_a_mesh_that_is_left_out_stays() -> None:
    builder, names = car()
    asset = load_asset(builder.glb()).without([names["wheel"]])
    positions = asset.surface.positions @ LINEAR.T + SHIFT
    result = asset.replace(positions, jacobians=np.tile(LINEAR, (len(positions), 1, 1)))
    before, after = (Player(glb).at(None, names["wheel"]).verts for glb in (builder.glb(), result))
    np.testing.assert_allclose(after, before, atol=1e-6)


def test_pointers_to_the_translation_of_a_node_are_animations_of_it() -> None:
    builder, names = car()
    channel = builder.root["animations"][0]["channels"][1]
    pointer = {"pointer": f"/nodes/{names['door']}/translation"}
    channel["target"] = {"path": "pointer", "extensions": {"KHR_animation_pointer": pointer}}
    after = Player(moved(builder.glb(), 2 * np.eye(3), np.zeros(3)))
    sampler = after.animation["samplers"][after.animation["channels"][1]["sampler"]]
    np.testing.assert_allclose(after.read(sampler["output"]), [[0, 0, 6], [0, 0, 8]], atol=1e-6)


def test_bones_without_a_skin_turn_the_meshes_below_them_as_before() -> None:
    builder = Builder()
    hand = part(builder, BALL, in_scene=False, translation=[0.0, 2.0, 0.0], scale=[0.3] * 3)
    elbow = builder.node(in_scene=False, translation=[0.0, 3.0, 0.0], children=[hand])
    part(builder, BOX, children=[elbow])
    # Some exporters list the bones in a skin that no mesh uses.
    builder.root["skins"] = [{"joints": [elbow]}]
    before, after = origins(builder.glb()), origins(moved(builder.glb(), LINEAR, SHIFT))
    for node in (hand, elbow):
        np.testing.assert_allclose(after[node], LINEAR @ before[node] + SHIFT, atol=1e-6)


def test_what_is_kept_of_a_mesh_keeps_its_bits() -> None:
    builder, names = car()
    asset = load_asset(builder.glb())
    positions = asset.surface.positions @ LINEAR.T + SHIFT
    door = asset.surface.instance_of_vertex == asset.surface.instance_of_vertex.max()
    kept = door & (asset.surface.positions[:, 0] < 0)
    builder.root["animations"] = []
    asset = load_asset(builder.glb())
    positions[kept] = asset.surface.positions[kept]
    result = asset.replace(positions, jacobians=np.tile(LINEAR, (len(positions), 1, 1)))
    np.testing.assert_array_equal(load_asset(result).surface.positions[kept], asset.surface.positions[kept])
    np.testing.assert_array_equal(origins(result)[names["door"]], origins(builder.glb())[names["door"]])
