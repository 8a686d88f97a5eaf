"""Regions, handles, symmetry and limits of a request: what they select, what they refuse, and whole runs that obey."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from meshdeform.assets import Asset, build_glb, load_asset
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.weld import weld
from meshdeform.rendering.cameras import CameraFrame
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.requests.groups import grouped
from meshdeform.requests.selection import SelectionParams, check_selections
from meshdeform.runs.control import AssetControl, WeldedSurface, read_control
from tests.cases import each_case
from tests.unit.assets.builders import Builder
from tests.unit.runs.jobs import finished, started

BALL = icosphere(3)
POINTS = BALL.verts
FACES = BALL.faces


def figure() -> bytes:
    """A ball with a red upper half, whose right half follows the joint `Arm`, and a second ball beside it."""
    builder = Builder()
    right, up = POINTS[:, 0] > 0, POINTS[:, 1] > 0
    joints = np.zeros((len(POINTS), 4), np.uint8)
    joints[right, 0] = 1
    weights = np.tile(np.array([1, 0, 0, 0], np.float32), (len(POINTS), 1))
    colors = np.where(up[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]).astype(np.float32)
    made = builder.primitive(POINTS, FACES.astype(np.uint16), JOINTS_0=joints, WEIGHTS_0=weights, COLOR_0=colors)
    body = builder.mesh(made, name="torso")
    root, arm = builder.node(name="Root"), builder.node(name="Arm")
    builder.root["skins"] = [{"joints": [root, arm]}]
    builder.node(body, name="Body", skin=0)
    beside = builder.mesh(builder.primitive(0.3 * POINTS + [2, 0, 0], FACES.astype(np.uint16)), name="lamp")
    builder.node(beside, name="Lamp")
    return builder.glb()


ASSET = load_asset(figure())
SURFACE = WeldedSurface(ASSET, weld(ASSET.surface.positions, ASSET.surface.triangles))


def selected(**where: Any) -> np.ndarray[Any, np.dtype[np.bool_]]:
    return SURFACE.faces("regions", 0, SelectionParams.model_validate(where))


def corners_where(flags: Any) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Flags of the faces of which all corners have a property."""
    return np.asarray(flags)[SURFACE.mesh.faces].all(1)


def test_every_kind_of_selection_selects_what_it_says() -> None:
    verts, count = SURFACE.mesh.verts, len(FACES)
    big = verts[:, 0] < 1.5
    assert np.array_equal(selected(node="Body"), corners_where(big))
    assert np.array_equal(selected(mesh="lamp"), corners_where(~big))
    assert np.array_equal(selected(component=1), corners_where(~big))
    assert np.array_equal(selected(joint={"name": "Arm"}), corners_where(big & (verts[:, 0] > 0)))
    assert np.array_equal(selected(color={"rgb": [1, 0, 0]}), corners_where(big & (verts[:, 1] > 0)))
    inside = {"min": [-2, -2, -2], "max": [1, 0.25, 2]}
    assert np.array_equal(selected(box=inside), corners_where((verts[:, 0] <= 1) & (verts[:, 1] <= 0.25)))
    near = np.linalg.norm(verts - [2, 0, 0], axis=1) <= 0.31
    assert np.array_equal(selected(sphere={"center": [2, 0, 0], "radius": 0.31}), corners_where(near))
    around = np.linalg.norm(verts[:, 1:], axis=1) <= 0.35
    line = {"start": [-3, 0, 0], "end": [3, 0, 0], "radius": 0.35}
    assert np.array_equal(selected(capsule=line), corners_where(around))
    assert np.flatnonzero(selected(faces=[3, [10, 12], 2 * count - 1])).tolist() == [3, 10, 11, 12, 2 * count - 1]


@each_case(
    "where,detail,advice",
    [
        ({"node": "body"}, "no node named 'body'", "Did you mean 'Body'?"),
        ({"mesh": "lmap"}, "no mesh named 'lmap'", "Did you mean 'lamp'?"),
        ({"joint": {"name": "Leg"}}, "no joint named 'Leg'", "'Root'"),
        ({"joint": {"name": "Root", "above": 0.9}, "x": 1}, "", ""),
        ({"color": {"rgb": [0, 1, 0]}}, "no triangle has this vertex colour", "within"),
        ({"box": {"min": [5, 5, 5], "max": [6, 6, 6]}}, "in the box", "between"),
        ({"faces": [[5, 99999]]}, "no triangles 5 to 99999", "0 to 2559"),
        ({"component": 7}, "no component 7", "0 to 1"),
    ],
)
def test_a_region_of_nothing_is_refused_with_what_there_is(where: dict[str, Any], detail: str, advice: str) -> None:
    if "x" in where:
        with pytest.raises(ValueError, match="Extra inputs"):
            DeformParams.model_validate({"control": {"regions": [where]}})
        return
    with pytest.raises(ParameterError, match=detail) as refused:
        controlled(regions=[{"node": "Lamp"}, where])
    assert advice in str(refused.value.advice_text)
    assert refused.value.extra["errors"][0]["loc"] == ["params", "control", "regions", 1, next(iter(where))]


def test_names_are_checked_without_the_geometry() -> None:
    summary = ASSET.summary
    lists = {name: getattr(summary, name) for name in ("nodes", "mesh_names", "materials", "joints")}
    assert [item["name"] for item in summary.joints] == ["Root", "Arm"]
    check_selections(
        "regions",
        [SelectionParams(node="Body"), SelectionParams(joint={"name": "Arm"}), SelectionParams(faces=[9])],
        lists,
    )
    with pytest.raises(ParameterError, match="no mesh named"):
        check_selections("regions", [SelectionParams(mesh="tors")], lists)
    check_selections("regions", [SelectionParams(mesh="tors")], {})


def controlled(asset: Asset = ASSET, **params: Any) -> AssetControl:
    welded = weld(asset.surface.positions, asset.surface.triangles)
    frame = CameraFrame.around(welded.mesh.verts)
    resolved = resolve(DeformParams.model_validate(grouped(params)))
    return read_control(resolved, WeldedSurface(asset, welded), frame, RestMesh.of(frame.place(welded.mesh)))


def test_only_keeps_its_complement_and_keep_wins() -> None:
    upper, lower = ({"box": {"min": [-3, y, -3], "max": [3, y + 3, 3]}} for y in (0, -3))
    faces = SURFACE.mesh.faces
    outside = np.unique(faces[~selected(**upper)])
    only = controlled(regions=[{**upper, "action": "only"}])
    assert np.flatnonzero(only.constraints.kept).tolist() == outside.tolist()
    both = controlled(regions=[{**upper, "action": "only"}, {"node": "Lamp"}])
    lamp = selected(node="Lamp")
    assert np.flatnonzero(both.constraints.kept).tolist() == np.union1d(outside, np.unique(faces[lamp])).tolist()
    assert [item["faces"] for item in both.regions] == [int(selected(**upper).sum()), 1280]
    assert [item["action"] for item in both.regions] == ["only", "keep"]
    with pytest.raises(ParameterError, match="keep the whole asset"):
        controlled(regions=[{"node": "Body"}, {"node": "Lamp"}])
    assert controlled(regions=[{"node": "Lamp"}], falloff=0).constraints.falloff == 0
    assert np.isin(outside, np.unique(faces[selected(**lower)])).any()


def test_a_rigid_part_that_touches_what_is_kept_is_kept_as_a_whole() -> None:
    cap = {"box": {"min": [1.9, 0.1, -1], "max": [2.1, 1, 1]}}
    found = controlled(regions=[cap], rigid=[{"node": "Lamp"}])
    assert found.bodies == []
    lamp = np.unique(SURFACE.mesh.faces[selected(node="Lamp")])
    assert np.flatnonzero(found.constraints.kept).tolist() == lamp.tolist()
    assert len(controlled(regions=[cap], rigid=[{"node": "Body", "mode": "similarity"}]).bodies) == 1


def one_ball() -> Asset:
    return load_asset(build_glb(POINTS, FACES))


@each_case(
    "params,detail",
    [
        ({"handles": [{"vertex": 99999, "to": [0, 0, 0]}]}, "no triangle has the vertex 99999"),
        ({"handles": [{"position": [2, 0, 0], "to": [0, 0, 0]}], "regions": [{"node": "Lamp"}]}, "point that is kept"),
        ({"handles": [{"position": [2, 0, 0], "to": [0, 0, 0]}], "rigid": [{"node": "Lamp"}]}, "point of a rigid part"),
        ({"handles": [{"position": [2, 0, 0], "to": [0, 1e9, 0]}]}, "times as far from the asset"),
        ({"handles": [{"position": [0, 0, -1e9], "to": [0, 0, 0]}]}, "times as far from the asset"),
        ({"symmetry": "x"}, "not symmetric along x: [0-9,]+ of its 1,284"),
    ],
)
def test_control_that_the_asset_cannot_obey_is_refused(params: dict[str, Any], detail: str) -> None:
    with pytest.raises(ParameterError, match=detail):
        controlled(**params)


def test_documents_that_contradict_themselves_are_refused() -> None:
    for params in (
        {"handles": [{"to": [0, 0, 0]}]},
        {"handles": [{"vertex": 1, "position": [0, 0, 0], "to": [0, 0, 0]}]},
        {"handles": [{"vertex": 1, "to": [0, 0, 0], "weight": 0}]},
        {"handles": [{"vertex": 1, "to": [0, 1e300, 0]}]},
        {"handles": [{"position": [-1e308, 0, 0], "to": [0, 0, 0]}]},
        {"regions": [{"sphere": {"center": [0, 1e300, 0], "radius": 1}}]},
        {"landmarks": [{"source": [1e300, 0, 0], "target": 0}]},
        {"align": [1.0] * 16},
        {"regions": [{"node": "a", "mesh": "b"}]},
        {"regions": [{"box": {"min": [0, 1, 0], "max": [1, 0, 1]}}]},
        {"symmetry": "w"},
    ):
        with pytest.raises(ValueError, match="validation error"):
            DeformParams.model_validate(grouped(params))


def test_symmetry_is_found_and_what_is_kept_is_kept_on_both_sides() -> None:
    ball = one_ball()
    side = {"sphere": {"center": [1, 0, 0], "radius": 0.4}}
    found = controlled(ball, symmetry="auto", regions=[side])
    assert found.partners is not None
    assert found.partners.axis == 0
    kept = POINTS[np.asarray(found.constraints.kept)]
    assert (kept[:, 0] < 0).sum() == (kept[:, 0] > 0).sum() > 5
    assert controlled(symmetry="auto").partners is not None  # a second ball along x leaves z
    lopsided = TriangleMesh(BALL.verts + 0.05 * np.random.default_rng(0).random(BALL.verts.shape), BALL.faces)
    none = controlled(load_asset(build_glb(lopsided.verts, FACES)), symmetry="auto")
    assert none.partners is None
    assert none.constraints.mirror is None


def test_a_run_obeys_all_of_it_and_a_resumed_one_bit_for_bit() -> None:
    normals = (POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)).astype(np.float32)
    builder = Builder()
    made = builder.primitive(POINTS, FACES.astype(np.uint16), NORMAL=normals)
    builder.node(builder.mesh(made, name="ball"), name="Ball", translation=[10, 0.1, 0.3], scale=[0.7, 0.7, 0.7])
    asset = builder.glb()
    source = load_asset(asset).surface
    top = source.positions[:, 1] > 0.5
    params = {
        "control": {
            "regions": [{"box": {"min": [0, 0.5, -9], "max": [20, 9, 9]}}],
            "symmetry": "x",
            "handles": [{"position": [10, -0.6, 0.3], "to": [10, -0.8, 0.4]}],
        }
    }
    given = {"steps": 12, "seed": 3, "learning_rate": 0.02, **params}
    whole, half = started(asset, **given), started(asset, **given)
    result, report = finished(whole)
    written = load_asset(result).surface
    assert np.array_equal(written.positions[top], source.positions[top])
    inner = np.setdiff1d(np.flatnonzero(top), np.unique(source.triangles[~top[source.triangles].all(1)]))
    assert np.array_equal(written.normals[inner], source.normals[inner])
    assert np.abs(written.positions - source.positions).max() > 0.1
    assert report["regions"]["max_moved"] == 0.0
    assert report["regions"]["kept_vertices"] == top.sum()
    assert report["symmetry"]["axis"] == "x"
    assert report["symmetry"]["added_deviation"] < 1e-6
    assert report["handles"][0]["distance"] < 1e-6
    next(step for step in half if step.step == 7)
    assert finished(started(asset, **given, checkpoint=half.checkpoint()))[0] == result
