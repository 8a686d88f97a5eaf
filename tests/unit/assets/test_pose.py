"""The surface is what viewers show, against skinning written without the code under test."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from tests.cases import each_case
from tests.unit.assets.builders import Builder
from tests.unit.assets.playing import Player
from tests.unit.assets.test_rig import TURN, arm


def bent_arm(*, targets: bool = False) -> Builder:
    """An arm whose file shows it bent."""
    builder = arm(targets=targets)
    builder.root["nodes"][builder.root["skins"][0]["joints"][1]]["rotation"] = TURN
    return builder


def test_a_skin_is_placed_by_the_pose_of_its_nodes() -> None:
    builder = bent_arm()
    surface = load_asset(builder.glb()).surface
    skin, straight = Player(builder.glb()).at(None, 0).verts, Player(arm().glb()).at(None, 0).verts
    assert np.abs(skin - straight).max() > 0.5, "the bind pose is another"
    np.testing.assert_allclose(surface.positions[: len(skin)], skin, atol=1e-6)
    # The normals of an upright tube point away from its bones; both turn by the same blend of maps.
    np.testing.assert_allclose(np.linalg.norm(surface.normals[: len(skin)], axis=1), 1, atol=1e-12)
    triangles = surface.triangles[(surface.triangles < len(skin)).all(1)]
    a, b, c = surface.positions[triangles].transpose(1, 0, 2)
    assert ((np.cross(b - a, c - a)[:, None] * surface.normals[triangles]).sum(2) > 0).all()
    assert not surface.stays.any()


@each_case("follows", [False, True])
def test_a_new_shape_is_shown_as_it_was_given(follows: bool) -> None:
    builder, random = bent_arm(targets=True), np.random.default_rng(3)
    builder.root["meshes"][0]["weights"] = [0.7]
    asset = load_asset(builder.glb())
    moved = asset.surface.positions + 0.1 * random.standard_normal(asset.surface.positions.shape)
    jacobians = np.tile(np.eye(3), (len(moved), 1, 1)) if follows else None
    result = asset.replace(moved, jacobians=jacobians)
    np.testing.assert_allclose(load_asset(result).surface.positions, moved, atol=2e-6)


def test_what_did_not_move_keeps_its_bits() -> None:
    builder = bent_arm()
    asset = load_asset(builder.glb())
    moved = asset.surface.positions.copy()
    moved[:8] += 0.25
    before, after = (Player(glb) for glb in (builder.glb(), asset.replace(moved, asset.surface.normals)))
    attributes = [player.root["meshes"][0]["primitives"][0]["attributes"] for player in (before, after)]
    for name in ("POSITION", "NORMAL"):
        old, new = before.read(attributes[0][name]), after.read(attributes[1][name])
        np.testing.assert_array_equal(new[8:], old[8:])
    assert (after.read(attributes[1]["POSITION"])[:8] != before.read(attributes[0]["POSITION"])[:8]).any()


@each_case("scale", [[1, 1, 0], [0, 0, 0], [1, 1, 1e-9]])
def test_vertices_that_their_joints_flatten_stay_and_are_counted(scale: list[float]) -> None:
    builder = arm()
    last = builder.root["skins"][0]["joints"][-1]
    builder.root["nodes"][last]["scale"] = scale
    asset = load_asset(builder.glb())
    flattened = asset.surface.stays
    # Those that follow the last joint alone; between joints the others' share is enough.
    assert 0 < flattened.sum() < len(flattened) / 2
    read = [Player(glb) for glb in (builder.glb(), asset.replace(asset.surface.positions + 1.0))]
    old, new = (each.read(each.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"]) for each in read)
    np.testing.assert_array_equal(new[flattened[: len(old)]], old[flattened[: len(old)]])
    assert (new[~flattened[: len(old)]] != old[~flattened[: len(old)]]).all()
    assert np.isfinite(new).all()
    assert np.abs(new).max() < 100, "a small change is no spike in other poses"


def test_a_skin_that_the_pose_hides_is_left_out_and_says_why() -> None:
    builder = arm()
    builder.root["nodes"][builder.root["skins"][0]["joints"][0]]["scale"] = [0, 0, 0]
    builder.node(builder.mesh(builder.primitive()))
    asset = load_asset(builder.glb())
    assert [item["reason"] for item in asset.surface.skipped if item["node"] == 0] == [
        "its transform flattens the mesh and cannot be inverted"
    ]


def test_a_mirrored_pose_keeps_the_outside_outside() -> None:
    builder = arm()
    builder.root["nodes"][-1]["scale"] = [-2, 2, 2]
    asset = load_asset(builder.glb())
    skin = len(Player(builder.glb()).at(None, 0).verts)
    surface = asset.surface
    triangles = surface.triangles[(surface.triangles < skin).all(1)]
    a, b, c = surface.positions[triangles].transpose(1, 0, 2)
    assert ((np.cross(b - a, c - a)[:, None] * surface.normals[triangles]).sum(2) > 0).all()


@pytest.mark.parametrize("vertex", [0, 5])
def test_vertices_without_weights_or_with_damaged_ones_are_placed_as_bound(vertex: int) -> None:
    builder = arm()
    primitive: dict[str, Any] = builder.root["meshes"][0]["primitives"][0]
    values = Player(builder.glb()).read(primitive["attributes"]["WEIGHTS_0"]).astype(np.float32)
    values[vertex] = 0 if vertex else np.inf
    primitive["attributes"]["WEIGHTS_0"] = builder.accessor(values)
    placed, whole = load_asset(builder.glb()).surface, load_asset(arm().glb()).surface
    np.testing.assert_allclose(placed.positions[vertex], whole.positions[vertex], atol=1e-6)
    assert json.dumps(placed.skipped) == "[]"


@each_case("time", [None, 0.0, 0.4, 1.0])
def test_a_scaled_skin_is_scaled_in_every_pose_also_where_the_file_is_bent(time: float | None) -> None:
    builder, centre = bent_arm(), np.array([0.2, -0.4, 0.1])
    asset = load_asset(builder.glb())
    positions = asset.surface.positions
    jacobians = np.tile(0.5 * np.eye(3), (len(positions), 1, 1))
    result = asset.replace(centre + 0.5 * (positions - centre), jacobians=jacobians)
    before, after = (Player(glb).at(time, 0).verts for glb in (builder.glb(), result))
    np.testing.assert_allclose(after, centre + 0.5 * (before - centre), atol=2e-6)
