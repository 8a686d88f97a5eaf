"""A run judges, draws and measures a skin in the pose that viewers show, and says what it measured in the bind pose."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import torch

from meshdeform.assets import build_glb, load_asset
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import load_prior
from meshdeform.rendering.cameras import Frame
from meshdeform.rendering.studio import Pose, preview_png
from meshdeform.runs.surfaces import Shown, pose_in_frame, welded_surface
from meshdeform.runs.verdict import likeness_and_before
from tests.unit.assets.playing import Player
from tests.unit.assets.test_rig import TURN, arm
from tests.unit.runs.jobs import finished, started


def bent_arm() -> bytes:
    """An arm whose file shows it bent."""
    builder = arm()
    builder.root["nodes"][builder.root["skins"][0]["joints"][1]]["rotation"] = TURN
    return builder.glb()


def run(asset: bytes) -> tuple[bytes, bytes, dict[str, Any]]:
    """Return result, preview and report of two steps."""
    job = started(asset, "a mushroom", steps=2, prior=load_prior("builtin", device="cpu"))
    result, report = finished(job)
    return result, job.finish()["preview.png"].data, report


def test_a_skin_is_judged_drawn_and_measured_in_the_pose_of_its_nodes() -> None:
    asset, (data, preview, report) = load_asset(bent_arm()), run(bent_arm())
    result, welded = load_asset(data), welded_surface(asset)
    skin = Player(data).at(None, 0).verts
    np.testing.assert_allclose(result.posed().positions[: len(skin)], skin, atol=1e-6)
    before, after = (welded.gather(each.posed().positions) for each in (asset, result))
    faces = welded.mesh.faces.numpy()
    posed = measure(before.verts.numpy(), faces, after.verts.numpy()).to_dict()
    assert report["posed_quality"] == posed
    bind = measure(welded.mesh.verts.numpy(), faces, welded.gather(result.surface.positions).verts.numpy())
    assert report["quality"]["area_ratio"] == pytest.approx(bind.area_ratio)
    assert report["quality"]["area_ratio"] != pytest.approx(posed["area_ratio"])
    compared = likeness_and_before(before, after, "a mushroom", {})
    assert report["likeness"] == json.loads(json.dumps(compared))
    poses = (Pose(each.positions, each.normals) for each in (asset.posed(), result.posed()))
    assert preview == preview_png(asset.appearance(), *poses)


def test_what_has_no_skin_is_shown_as_it_is_to_the_last_bit() -> None:
    ball = icosphere(1)
    asset = load_asset(build_glb(ball.verts.numpy(), ball.faces.numpy()))
    welded = welded_surface(asset)
    moved = welded.mesh.verts + torch.tensor(1e-12)
    shown = Shown.of(asset, asset, welded, moved)
    assert not shown.posed
    assert shown.source is welded.mesh
    assert torch.equal(shown.result.verts, moved)
    assert "posed_quality" not in run(asset.to_bytes())[2]


def test_the_pose_of_the_nodes_is_a_map_of_each_vertex_in_the_frame() -> None:
    asset = load_asset(bent_arm())
    welded = welded_surface(asset)
    frame = Frame.around(welded.mesh.verts)
    maps = pose_in_frame(asset, welded, frame)
    assert maps is not None
    verts = frame.enter(welded.mesh.verts).numpy()
    shown = np.einsum("nij,nj->ni", maps[:, :, :3], verts) + maps[:, :, 3]
    expected = frame.enter(welded.gather(asset.posed().positions).verts)
    np.testing.assert_allclose(shown, expected, atol=1e-9)
    straight = load_asset(arm().glb())
    assert pose_in_frame(straight, welded_surface(straight), frame) is None
