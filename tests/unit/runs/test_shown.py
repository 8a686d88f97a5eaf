"""All that a run of a skinned asset does, it does in the pose that viewers show."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from meshdeform.assets import build_glb, load_asset
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import load_prior
from meshdeform.rendering.studio import SurfaceState, preview_png
from meshdeform.runs.likeness import likeness_and_before
from meshdeform.runs.surfaces import Shown, welded_surface
from tests.cases import each_case
from tests.unit.assets.builders import Builder
from tests.unit.assets.playing import Player
from tests.unit.assets.test_pose import bent_arm
from tests.unit.runs.jobs import finished, started
from training.shapes import box

LYING = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Turns what stands on its side."""


def tower(*, skinned: bool) -> bytes:
    """A tower of two boxes; with a skin whose bind pose lies on its side, and which the file's nodes show standing."""
    lower, upper = box(2).verts * 0.5, box(2).verts * 0.3 + [0.0, 0.8, 0.0]
    verts = np.concatenate([lower, upper]) + [2.0, 0.5, 0.0]
    faces = np.concatenate([box(2).faces, box(2).faces + len(lower)]).astype(np.uint16)
    builder = Builder()
    if not skinned:
        builder.node(builder.mesh(builder.primitive(verts, faces)))
        return builder.glb()
    weights, joints = np.zeros((len(verts), 4), np.float32), np.zeros((len(verts), 4), np.uint8)
    weights[:, 0] = 1
    joints[len(lower) :, 0] = 1
    primitive = builder.primitive(verts @ LYING.T, faces, JOINTS_0=joints, WEIGHTS_0=weights)
    builder.node(builder.mesh(primitive), skin=0)
    nodes = [builder.node(in_scene=False) for _ in range(2)]
    builder.node(children=nodes)
    # The joints undo what the bind pose turned, one more than the other.
    binds = np.tile(np.eye(4), (2, 1, 1))
    binds[:, :3, :3] = LYING.T
    accessor = builder.accessor(binds.transpose(0, 2, 1).reshape(2, 16).astype(np.float32))
    builder.root["skins"] = [{"joints": nodes, "inverseBindMatrices": accessor}]
    return builder.glb()


@each_case(
    ("prompt", "more"),
    [
        ("a mushroom", {"prior": load_prior("builtin", device="cpu")}),
        ("", {"target": tower(skinned=False), "guidance": "target"}),
        ("twice as tall", {"source_noun": "lamp"}),
    ],
)
def test_a_skin_becomes_what_the_same_shape_without_one_becomes(prompt: str, more: dict[str, Any]) -> None:
    if "target" in more:
        more = {**more, "target": build_glb(icosphere(2).verts, icosphere(2).faces)}
    results, reports = [], []
    for skinned in (False, True):
        result, report = finished(started(tower(skinned=skinned), prompt, steps=3, **more))
        results.append(load_asset(result).surface.positions)
        reports.append(report)
    np.testing.assert_allclose(results[1], results[0], atol=1e-4)
    assert np.abs(results[0] - load_asset(tower(skinned=False)).surface.positions).max() > 0.01
    assert reports[1]["source_noun"] == reports[0]["source_noun"]
    warnings = [[text for text in report["input"]["warnings"] if "Z up" in text] for report in reports]
    assert warnings == [[], []]


def test_a_skin_is_judged_drawn_and_measured_as_it_is_shown() -> None:
    asset = load_asset(bent_arm().glb())
    job = started(bent_arm().glb(), "a mushroom", steps=2, prior=load_prior("builtin", device="cpu"))
    data, report = finished(job)
    result, welded = load_asset(data), welded_surface(asset)
    skin = Player(data).at(None, 0).verts
    np.testing.assert_allclose(result.surface.positions[: len(skin)], skin, atol=1e-6)
    before, after = welded.mesh, Shown.of(asset, result, welded, job.verts()).result
    assert report["quality"] == measure(before.verts, before.faces, after.verts).to_dict()
    compared = likeness_and_before(before, after, "a mushroom")
    assert report["likeness"] == json.loads(json.dumps(compared))
    poses = (SurfaceState(each.surface.positions, each.surface.normals) for each in (asset, result))
    assert job.finish()["preview.png"].data == preview_png(asset.appearance(), *poses)


def test_a_result_is_compared_to_the_last_bit() -> None:
    ball = icosphere(1)
    asset = load_asset(build_glb(ball.verts, ball.faces))
    welded = welded_surface(asset)
    moved = welded.mesh.verts + np.array(1e-12)
    shown = Shown.of(asset, asset, welded, moved)
    assert shown.source is welded.mesh
    assert np.array_equal(shown.result.verts, moved)


def test_vertices_that_cannot_be_moved_are_told() -> None:
    builder = bent_arm()
    builder.root["nodes"][builder.root["skins"][0]["joints"][-1]]["scale"] = [1, 0, 1]
    result, report = finished(started(builder.glb(), steps=2))
    count = report["skipped"]["fixed_vertices"]
    assert count == load_asset(builder.glb()).surface.stays.sum() > 0
    assert any(f"{count:,} of" in text and "stayed as they were" in text for text in report["warnings"])
    assert load_asset(result).surface.stays.sum() == count
