"""The pose that viewers show, against skinning written without the code under test."""

from __future__ import annotations

import numpy as np

from meshdeform.assets import load_asset
from tests.unit.assets.playing import Player
from tests.unit.assets.test_rig import TURN, arm


def test_a_skin_is_shown_in_the_pose_of_its_nodes() -> None:
    builder = arm()
    joints = builder.root["skins"][0]["joints"]
    builder.root["nodes"][joints[1]]["rotation"] = TURN
    player, asset = Player(builder.glb()), load_asset(builder.glb())
    shown = asset.posed()
    skin = player.at(None, 0).verts
    assert not np.allclose(asset.surface.positions[: len(skin)], skin, atol=0.1), "the bind pose is another"
    np.testing.assert_allclose(shown.positions[: len(skin)], skin, atol=1e-6)
    # The normals of an upright tube point away from its bones; both turn by the same blend of maps.
    lengths = np.linalg.norm(shown.normals[: len(skin)], axis=1)
    np.testing.assert_allclose(lengths, 1, atol=1e-12)
    triangles = shown.triangles[(shown.triangles < len(skin)).all(1)]
    a, b, c = shown.positions[triangles].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    assert ((across[:, None] * shown.normals[triangles]).sum(2) > 0).all()


def test_what_has_no_skin_is_shown_where_it_is() -> None:
    builder = arm()
    asset = load_asset(builder.glb())
    hat = asset.surface.instance_of_vertex == asset.surface.instance_of_vertex.max()
    np.testing.assert_array_equal(asset.posed().positions[hat], asset.surface.positions[hat])
