"""Rigs that follow the shape: joints, bind poses, animations and morph targets, against closed forms."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.assets.surface_pieces import Rig
from meshdeform.errors import ShapeError
from tests.cases import each_case
from tests.unit.assets.builders import Builder
from tests.unit.assets.playing import Player

Floats = NDArray[np.float64]

RINGS, SIDES, HEIGHT = 13, 8, 3.0
TURN = [0.0, 0.0, 0.38268343, 0.92387953]
TIMES = (0.0, 0.4, 1.0)


def tube() -> tuple[Floats, NDArray[np.uint16]]:
    """A tube along +Y from 0 to HEIGHT, open at both ends."""
    angles = np.arange(SIDES) * 2 * np.pi / SIDES
    verts = np.array(
        [[0.3 * np.cos(a), y, 0.3 * np.sin(a)] for y in np.linspace(0, HEIGHT, RINGS) for a in angles], np.float64
    )
    faces = []
    for ring, side in itertools.product(range(RINGS - 1), range(SIDES)):
        a, b = ring * SIDES + side, ring * SIDES + (side + 1) % SIDES
        faces += [[a, a + SIDES, b], [b, a + SIDES, b + SIDES]]
    return verts, np.array(faces, np.uint16)


def arm(*, targets: bool = False) -> Builder:
    """An arm of three joints below a turned, scaled node: a helper between two of them, a hat on the last, animated."""
    builder = Builder()
    verts, faces = tube()
    place = np.clip(verts[:, 1] / (HEIGHT / 2), 0, 2)
    joints = np.zeros((len(verts), 4), np.uint8)
    joints[:, 0], joints[:, 1] = np.floor(place).clip(0, 1), np.floor(place).clip(0, 1) + 1
    upper = place - joints[:, 0]
    weights = np.column_stack([1 - upper, upper, 0 * upper, 0 * upper]).astype(np.float32)
    primitive = builder.primitive(verts, faces, JOINTS_0=joints, WEIGHTS_0=weights, NORMAL=_outward(verts))
    if targets:
        bulge = (0.2 * _outward(verts) * np.sin(verts[:, 1:2])).astype(np.float32)
        turned = (0.1 * np.roll(_outward(verts), 1, axis=1)).astype(np.float32)
        primitive["targets"] = [{"POSITION": builder.accessor(bulge, bounds=True), "NORMAL": builder.accessor(turned)}]
    skinned = builder.node(builder.mesh(primitive), skin=0)
    # The armature is scaled by two and turned about Z; offsets of joints are in its space.
    half = HEIGHT / 4
    hat = builder.node(builder.mesh(builder.primitive()), in_scene=False, translation=[0, 0.1, 0])
    last = builder.node(in_scene=False, translation=[0, half - 0.25, 0], children=[hat])
    helper = builder.node(in_scene=False, translation=[0, 0.25, 0], children=[last])
    middle = builder.node(in_scene=False, translation=[0, half, 0], children=[helper])
    first = builder.node(in_scene=False, rotation=[*(-np.array(TURN[:3])), TURN[3]], children=[middle])
    builder.node(scale=[2, 2, 2], rotation=TURN, children=[first])
    binds = np.stack([_bind(y) for y in (0.0, HEIGHT / 2, HEIGHT)])
    joint_list = [first, middle, last]
    builder.root["skins"] = [{"joints": joint_list, "inverseBindMatrices": builder.accessor(binds)}]
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    rotation = builder.accessor(np.array([[0, 0, 0, 1], TURN], np.float32))
    walk = builder.accessor(np.array([[0, 0, 0], [0.5, 0.25, 0]], np.float32))
    still = np.zeros((2, 3, 3), np.float32)
    still[:, 1] = [0, half, 0]
    still[1, 0] = [0, 1, 0]
    samplers = [
        {"input": times, "output": rotation},
        {"input": times, "output": walk},
        {"input": times, "output": builder.accessor(still.reshape(-1, 3)), "interpolation": "CUBICSPLINE"},
    ]
    channels = [
        {"sampler": 0, "target": {"node": middle, "path": "rotation"}},
        {"sampler": 1, "target": {"node": first, "path": "translation"}},
        {"sampler": 2, "target": {"node": middle, "path": "translation"}},
    ]
    builder.root["animations"] = [{"samplers": samplers, "channels": channels}]
    assert skinned == 0
    return builder


def _outward(verts: Floats) -> NDArray[np.float32]:
    flat = verts * [1, 0, 1]
    return np.asarray(flat / np.linalg.norm(flat, axis=1, keepdims=True), np.float32)


def _bind(height: float) -> NDArray[np.float32]:
    """The inverse of a joint at this height, scaled by two as its armature is."""
    matrix = np.diag([0.5, 0.5, 0.5, 1.0])
    matrix[:3, 3] = [0, -height / 2, 0]
    return np.asarray(matrix.T.reshape(16), np.float32)


def deformed(builder: Builder, linear: Floats, shift: Floats, **more: Any) -> bytes:
    """The asset after an affine map, with its rig following."""
    asset = load_asset(builder.glb())
    positions = asset.surface.positions @ linear.T + shift
    jacobians = np.tile(linear, (len(positions), 1, 1))
    return asset.replace(positions, jacobians=jacobians, **more)


def hat_of(player: Player) -> int:
    return next(i for i, node in enumerate(player.root["nodes"]) if "mesh" in node and "skin" not in node)


def test_what_does_not_move_changes_nothing() -> None:
    asset = load_asset(arm(targets=True).glb())
    surface = asset.surface
    still = np.tile(np.eye(3), (len(surface.positions), 1, 1))
    assert asset.replace(surface.positions, jacobians=still) == asset.replace(surface.positions)
    assert asset.rig() == Rig(joints=3, morph_targets=1, animations=1)
    assert asset.rig()
    assert not Rig(0, 0, 3)
    with pytest.raises(ShapeError, match="jacobians"):
        asset.replace(asset.surface.positions, jacobians=np.zeros((3, 3, 3)))


@each_case("compact", [False, True])
def test_a_scaled_character_plays_as_the_scaled_animation(compact: bool) -> None:
    builder, centre = arm(), np.array([0.2, -0.4, 0.1])
    source = Player(builder.glb())
    result = Player(deformed(builder, 1.75 * np.eye(3), -0.75 * centre, compact=compact))
    for time in (None, *TIMES):
        before, after = source.at(time, 0), result.at(time, 0)
        np.testing.assert_allclose(after.verts, centre + 1.75 * (before.verts - centre), atol=2e-6)
    # The hat was scaled where it is, and stays there at rest.
    hats = [player.at(None, hat_of(player)).verts for player in (source, result)]
    np.testing.assert_allclose(hats[1], centre + 1.75 * (hats[0] - centre), atol=2e-6)


def test_every_affine_map_moves_joints_exactly_and_leaves_the_bind_pose_alone() -> None:
    builder, shift = arm(), np.array([1.0, 2.0, -1.0])
    linear = np.array([[1.5, 0.2, 0.0], [-0.1, 0.8, 0.1], [0.0, 0.3, 2.0]])
    source, result = Player(builder.glb()), Player(deformed(builder, linear, shift))
    np.testing.assert_allclose(result.at(None, 0).verts, source.at(None, 0).verts @ linear.T + shift, atol=2e-6)
    before, after = source.worlds(None), result.worlds(None)
    for joint in source.root["skins"][0]["joints"]:
        np.testing.assert_allclose(after[joint][:3, 3], linear @ before[joint][:3, 3] + shift, atol=2e-6)
        np.testing.assert_allclose(after[joint][:3, :3], before[joint][:3, :3], atol=1e-6)
    matrices = result.read(result.root["skins"][0]["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
    for joint, bind in zip(result.root["skins"][0]["joints"], matrices, strict=True):
        np.testing.assert_allclose(after[joint] @ bind, np.eye(4), atol=2e-6)


def test_a_limb_that_moved_does_not_tear_when_it_plays() -> None:
    """The limb has been pushed aside; joints that stayed where they were would swing it on a long lever."""
    builder = arm()
    asset = load_asset(builder.glb())
    at = asset.surface.positions
    positions = at + np.column_stack([2.5 + 0.2 * np.sin(2 * at[:, 1]), 0 * at[:, 1], 0 * at[:, 1]])
    jacobians = np.tile(np.eye(3), (len(at), 1, 1))
    jacobians[:, 0, 1] = 0.4 * np.cos(2 * at[:, 1])

    def stretch(glb: bytes) -> float:
        player = Player(glb)
        rest = player.at(None, 0).lengths
        return max(float(np.abs(np.log(player.at(time, 0).lengths / rest)).max()) for time in TIMES)

    source = stretch(builder.glb())
    kept, followed = (stretch(asset.replace(positions, jacobians=j)) for j in (None, jacobians))
    assert followed < 1.2 * source
    assert kept > 2 * source


def test_morph_targets_are_carried_along_exactly_by_an_affine_map() -> None:
    builder = arm(targets=True)
    linear = np.array([[1.5, 0.2, 0.0], [-0.1, 0.8, 0.1], [0.0, 0.3, 2.0]])
    source = Player(builder.glb())
    asset = load_asset(builder.glb())
    cofactors = np.linalg.inv(linear).T
    normals = asset.surface.normals @ cofactors.T
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    jacobians = np.tile(linear, (len(normals), 1, 1))
    result = Player(asset.replace(asset.surface.positions @ linear.T, normals, jacobians=jacobians))
    primitives = [player.root["meshes"][0]["primitives"][0] for player in (source, result)]
    moved = [
        player.read(each["targets"][0]["POSITION"]) for player, each in zip((source, result), primitives, strict=True)
    ]
    np.testing.assert_allclose(moved[1], moved[0] @ linear.T, atol=1e-6)
    shown = [
        player.read(each["attributes"]["NORMAL"]) + player.read(each["targets"][0]["NORMAL"])
        for player, each in zip((source, result), primitives, strict=True)
    ]
    wanted = shown[0] @ cofactors.T
    wanted *= np.linalg.norm(shown[0], axis=1, keepdims=True) / np.linalg.norm(wanted, axis=1, keepdims=True)
    np.testing.assert_allclose(shown[1], wanted, atol=1e-5)


def test_targets_of_a_placed_mesh_are_carried_in_its_own_space() -> None:
    builder = Builder()
    primitive = builder.primitive()
    primitive["targets"] = [{"POSITION": builder.accessor(np.eye(4, 3, dtype=np.float32), bounds=True)}]
    builder.node(builder.mesh(primitive), scale=[1, 2, 4], rotation=TURN)
    linear = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.25, 3.0]])
    source, result = Player(builder.glb()), Player(deformed(builder, linear, np.zeros(3)))
    deltas = [p.read(p.root["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]) for p in (source, result)]
    placed = [delta @ source.worlds(None)[0][:3, :3].T for delta in deltas]
    np.testing.assert_allclose(placed[1], placed[0] @ linear.T, atol=1e-6)


def test_displacements_of_a_target_that_are_not_finite_stay_as_they_are() -> None:
    added = np.eye(4, 3, dtype=np.float32)
    added[0], added[1, 2], added[2] = np.nan, -np.inf, 3e38
    builder = Builder()
    primitive = builder.primitive()
    nowhere = np.full((4, 3), np.nan, np.float32)
    primitive["targets"] = [{"POSITION": builder.accessor(added)}, {"POSITION": builder.accessor(nowhere)}]
    builder.node(builder.mesh(primitive))
    player = Player(deformed(builder, 2.0 * np.eye(3), np.zeros(3)))
    written = [target["POSITION"] for target in player.root["meshes"][0]["primitives"][0]["targets"]]
    np.testing.assert_array_equal(player.read(written[0])[:3], added[:3])
    np.testing.assert_array_equal(player.read(written[1]), nowhere)
    bounds = [player.root["accessors"][at] for at in written]
    assert [each["max"] for each in bounds] == [[np.float32(3e38)] * 3, [0.0] * 3]
