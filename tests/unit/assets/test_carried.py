"""Points and lines follow the surface; planes that make the object small are noticed."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.assets import Limits, inspect_asset, load_asset
from meshdeform.assets.build import Primitive, build_glb
from meshdeform.errors import AssetEmptyError, AssetTooLargeError
from meshdeform.geometry.shapes import icosphere
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_VERTS, Builder, notable, unpack
from tests.unit.assets.test_replace import accessor, position
from training.shapes import grid

POINTS = np.float32([[1, 0, 0], [5, 5, 5], [0.5, 0.5, 2]])


def mixed() -> Builder:
    """Return a quad with points and a line in its mesh, and a node with points alone, turned and scaled."""
    builder = Builder()
    quad = builder.primitive()
    points = {**builder.primitive(POINTS, faces=None), "mode": 0}
    line = {"attributes": {"POSITION": quad["attributes"]["POSITION"]}, "mode": 3}
    mesh = builder.mesh(quad, points, line)
    builder.node(mesh, translation=[10, 0, 0])
    alone = builder.mesh({**builder.primitive(POINTS, faces=None), "mode": 0})
    builder.node(alone, translation=[10, 0, 0], scale=[1, 2, -1])
    return builder


def test_points_and_lines_follow_the_surface() -> None:
    asset = load_asset(mixed().glb())
    assert (len(asset.surface.positions), asset.summary.skipped) == (4, ())
    written = asset.replace(asset.surface.positions + [0.0, 3.0, 0.0])
    shift = np.float32([0, 3, 0])
    np.testing.assert_allclose(position(written, 0, 1), POINTS + shift, atol=1e-6)
    np.testing.assert_array_equal(position(written, 0, 2), QUAD_VERTS + shift)
    np.testing.assert_allclose(position(written, 1), POINTS + shift / 2, atol=1e-6)
    root, _, _ = unpack(written)
    assert [primitive.get("mode", 4) for primitive in root["meshes"][0]["primitives"]] == [4, 0, 3]
    root, binary, _ = unpack(asset.replace(asset.surface.positions + [0.0, 3.0, 0.0], morph=True))
    target = root["meshes"][0]["primitives"][1]["targets"][-1]["POSITION"]
    np.testing.assert_allclose(accessor(root, binary, target), np.tile([0, 3, 0], (3, 1)), atol=1e-6)


def test_a_point_on_the_surface_follows_its_vertex_and_one_beside_it_a_mean() -> None:
    asset = load_asset(mixed().glb())
    moved = np.float64([[0, 0, 0], [0, 0, 1], [0, 0, 2], [0, 0, 4]])
    got = position(asset.replace(asset.surface.positions + moved), 0, 1) - POINTS
    np.testing.assert_allclose(got[0], [0, 0, 1], atol=1e-6)
    assert (got[1:, 2] > 0).all()
    assert (got[1:, 2] < 4).all()
    np.testing.assert_array_equal(position(asset.replace(asset.surface.positions), 0, 1), POINTS)


def test_points_alone_are_refused_and_points_have_a_limit() -> None:
    builder = Builder()
    builder.node(builder.mesh({**builder.primitive(POINTS, faces=None), "mode": 0}))
    for read in (inspect_asset, load_asset):
        with pytest.raises(AssetEmptyError, match="points and lines only follow a surface"):
            read(builder.glb())
    with pytest.raises(AssetTooLargeError):
        inspect_asset(mixed().glb(), limits=Limits(max_triangles=2))


def test_points_that_are_not_finite_stay_as_they_are() -> None:
    builder = mixed()
    bad = POINTS.copy()
    bad[1, 1] = np.nan
    builder.root["meshes"][1]["primitives"][0]["attributes"]["POSITION"] = builder.accessor(bad)
    asset = load_asset(builder.glb())
    assert "not finite" in asset.summary.skipped[0]["reason"]
    np.testing.assert_array_equal(position(asset.replace(asset.surface.positions + 1), 1), bad)


BALL = icosphere(2)
GROUND = grid(2, 12.0).verts[:, [0, 2, 1]] - [0, 1, 0]


@each_case(
    ("width", "thickness", "merged", "left"),
    [(1.0, 0, False, True), (1.0, 0, True, True), (0.45, 0, False, False), (1.0, 0.2, False, False)],
)
def test_only_a_flat_backdrop_of_more_than_four_times_the_size_is_left_as_it_is(
    width: float, thickness: float, merged: bool, left: bool
) -> None:
    ball, ground = BALL.verts, GROUND * [width, 1, width]
    ground[:, 1] += thickness * (np.arange(len(ground)) % 2) - 0.1
    faces = grid(2, 12.0).faces
    parts = [Primitive(ball, BALL.faces, name="ball"), Primitive(ground, faces, name="Ground")]
    if merged:
        joined = np.concatenate([ball, ground]), np.concatenate([BALL.faces, faces + len(ball)])
        parts = [Primitive(*joined, name="all")]
    found = load_asset(build_glb(parts)).backdrop
    assert found is not None
    assert found.left is left
    np.testing.assert_array_equal(found.triangles, np.arange(len(BALL.faces) + len(faces)) >= len(BALL.faces))
    assert found.own_nodes is not merged
    assert ("params.control.backdrop" in found.warning) is left


def test_a_pole_is_no_backdrop_and_a_plane_alone_is_an_object() -> None:
    ball = Primitive(BALL.verts, BALL.faces, name="ball")
    pole = Primitive(BALL.verts * [0.05, 12, 0.05], BALL.faces, name="pole")
    assert notable(load_asset(build_glb([ball, pole]))) == ()
    plane = Primitive(GROUND, grid(2, 12.0).faces)
    assert notable(load_asset(build_glb([plane, plane]))) == ()
