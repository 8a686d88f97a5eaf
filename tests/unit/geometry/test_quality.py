"""Every figure on a mesh whose answer is known."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from meshdeform.assets.notices import coarse_share, coarseness_warnings
from meshdeform.geometry.appearance import Appearance, Paint, Texture
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.quality import MeshQuality, measure
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.texture_stretch import face_stretch, measure_texture_stretch, texel_corners
from tests.cases import each_case
from tests.creased import creased
from training.shapes import box, grid, torus, uv_sphere


def compare(mesh: TriangleMesh, verts: NDArray[np.float64]) -> MeshQuality:
    return measure(mesh.verts, mesh.faces, verts)


@each_case("mesh", [icosphere(2), torus()])
def test_a_similarity_changes_nothing_but_size(mesh: TriangleMesh) -> None:
    q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    turn = q * np.linalg.det(q)
    found = compare(mesh, 3 * mesh.verts @ turn.T + 5)
    assert found.flipped_faces == found.collapsed_faces == 0
    assert found.self_intersecting_faces_before == found.self_intersecting_faces_after == 0
    assert found.min_angle_p1_deg_after == pytest.approx(found.min_angle_p1_deg_before)
    assert found.symmetric_dirichlet_mean == pytest.approx(1.0)
    assert found.symmetric_dirichlet_p99 == pytest.approx(1.0)
    assert found.volume_ratio == pytest.approx(27.0)
    assert found.area_ratio == pytest.approx(9.0)
    assert found.area_ratio_spread == pytest.approx(0.0, abs=1e-9)
    assert found.kept_share == pytest.approx(1.0)
    inside_out = compare(mesh, mesh.verts * np.array([-1.0, 1, 1], np.float64))
    assert inside_out.volume_ratio == pytest.approx(-1)


def test_a_stretched_plane_by_hand() -> None:
    """Singular values 4 and 1; after the area scale of 4 they are 2 and 1/2: (4 + 1/4 + 1/4 + 4) / 4."""
    mesh = grid(4)
    found = compare(mesh, mesh.verts * np.array([4.0, 1.0, 1.0], np.float64))
    assert found.symmetric_dirichlet_mean == pytest.approx(8.5 / 4)
    assert found.area_ratio == pytest.approx(4.0)
    assert found.min_angle_p1_deg_before == pytest.approx(45.0)
    assert found.min_angle_p1_deg_after == pytest.approx(math.degrees(math.atan(0.25)))
    assert found.volume_ratio == 0.0


@each_case(("factor", "kept"), [(1.0, 1.0), (1.4, 1.0), (1 / 1.4, 1.0), (8.0, 0.9), (1 / 8, 0.9)])
def test_what_is_resized_keeps_its_shape_and_what_is_stretched_does_not(factor: float, kept: float) -> None:
    """Of two plates, a tenth of the area is drawn out, and all becomes five times as large."""
    small, large = grid(4), grid(4)
    plates = join(small, TriangleMesh(3 * large.verts + 5, large.faces))
    verts = 5 * plates.verts
    verts[: len(small.verts), 0] *= factor
    assert compare(plates, verts).kept_share == pytest.approx(kept)


def test_only_damage_is_told() -> None:
    found = compare(icosphere(1), icosphere(1).verts)
    assert found.warnings(5120) == []
    damaged = replace(found, flipped_faces=2, self_intersections_added=1234, collapsed_faces=1)
    (sentence,) = damaged.warnings(5120)
    for words in ("Damaged faces, of 5,120", "2 flipped", "1,234 newly cutting others", "1 without area"):
        assert words in sentence
    assert "flipped" not in replace(damaged, flipped_faces=0).warnings(5120)[0]


@each_case(
    ("before", "after", "flipped"), [(0, 80, 0), (0, 100, 1), (70, 100, 0), (70, 150, 0), (70, 175, 1), (95, 60, 0)]
)
def test_a_crease_is_folded_once_it_bends_by_a_right_angle(before: float, after: float, flipped: int) -> None:
    """Against the large square alone, a strip would be folded from 91 degrees on: so are many of hard-edged assets."""
    assert compare(creased(before), creased(after).verts).flipped_faces == flipped


def test_faces_that_collapse_are_counted_and_kept_out_of_the_rest() -> None:
    mesh = icosphere(2)
    verts = mesh.verts.copy()
    verts[mesh.faces[0]] = verts[mesh.faces[0, 0]].copy()
    found = compare(mesh, verts)
    # The face itself, and the three that had two of its corners.
    assert found.collapsed_faces == 4
    assert math.isfinite(found.symmetric_dirichlet_p99)
    line = compare(mesh, mesh.verts * np.array([1.0, 0.0, 0.0], np.float64))
    assert line.collapsed_faces == len(mesh.faces)


coordinate = st.sampled_from([0.0, 1.0, -1.0, 0.5, 1e-12, 3.0])
point = st.tuples(coordinate, coordinate, coordinate)


@settings(max_examples=80, deadline=None)
@given(
    st.lists(st.tuples(point, point), min_size=1, max_size=8),
    st.lists(st.tuples(*[st.integers(0, 99)] * 3), max_size=12),
)
def test_any_soup_has_finite_figures(
    rows: list[tuple[tuple[float, float, float], tuple[float, float, float]]], faces: list[tuple[int, int, int]]
) -> None:
    points = np.array(rows)
    corners = np.array(faces, np.int64).reshape(-1, 3) % len(rows)
    figures = measure(points[:, 0], corners, points[:, 1]).to_dict()
    assert set(figures) == set(MeshQuality.__dataclass_fields__)
    json.dumps(figures, allow_nan=False)


def meeting_sheets() -> TriangleMesh:
    """Return boxes that touch, a box through both, and a fan of needles, all far from the origin."""
    boxes = [
        TriangleMesh(box(4).verts + np.array([x, y, y / 2], np.float64), box(4).faces)
        for x, y in ((0.0, 0.0), (1.0, 0.0), (0.45, 0.2))
    ]
    fan = uv_sphere(3, 400)
    mesh = join(*boxes, TriangleMesh(fan.verts * np.array([1.0, 1e-7, 1.0], np.float64) + 3.0, fan.faces))
    return TriangleMesh(mesh.verts * 0.37 + 1000.0, mesh.faces)


def test_a_result_equal_to_its_source_up_to_rounding_has_no_new_flip_and_no_new_cut() -> None:
    mesh = meeting_sheets()
    assert compare(mesh, mesh.verts).self_intersecting_faces_before > 0
    noise = np.random.default_rng(0).normal(size=mesh.verts.shape)
    for verts in (mesh.verts, (mesh.verts - 3.1) / 0.7 * 0.7 + 3.1, mesh.verts + 1e-8 * noise):
        found = compare(mesh, verts)
        assert (found.flipped_faces, found.self_intersections_added, found.collapsed_faces) == (0, 0, 0)
        assert found.self_intersecting_faces_after == found.self_intersecting_faces_before


def test_turning_faces_that_touch_adds_no_cut() -> None:
    """A wall of boxes: their faces lie on each other, and rounding moves them out of their common planes."""
    places = np.array([[0.0, 0, 0], [1, 0, 0], [0.3, 1, 0], [1.3, 1, 0.2]], np.float64)
    wall = join(*(TriangleMesh(box(1).verts + place, box(1).faces) for place in places))
    for seed in range(4):
        turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
        found = compare(wall, 1.1 * wall.verts @ turn)
        assert found.self_intersections_added == 0
    row = join(box(1), TriangleMesh(box(1).verts + places[1] * 1.1, box(1).faces))
    pushed = row.verts.copy()
    pushed[8:] -= places[1] * 0.2
    assert compare(row, pushed).self_intersections_added > 0


def test_cuts_are_counted_against_rest_by_pairs() -> None:
    """A box that cuts one box moves on and cuts another: as many faces as before, but other pairs."""
    spot = np.array([[0.0, 0, 0], [4.0, 0, 0], [0.5, 0.25, 0.25]], np.float64)
    mesh = join(*(TriangleMesh(box(1).verts + at, box(1).faces) for at in spot))
    verts = mesh.verts.copy()
    verts[-len(box(1).verts) :, 0] += 4.0
    found = compare(mesh, verts)
    assert found.self_intersecting_faces_after == found.self_intersecting_faces_before > 0
    assert found.self_intersections_added == found.self_intersecting_faces_after
    assert compare(mesh, mesh.verts + 1.0).self_intersections_added == 0


# Triangles too large to bend: which assets are warned about.


def arrays(mesh: TriangleMesh, scale: float = 1.0):
    return mesh.verts * scale, mesh.faces


@each_case(
    "mesh,warned",
    [(box(1), True), (icosphere(0), True), (box(6), False), (icosphere(2), False), (torus(), False)],
    ids=["box", "icosahedron", "box 6", "sphere", "torus"],
)
@each_case("scale", [1e-3, 1e6])
def test_only_what_cannot_bend_is_warned_about(mesh, warned, scale) -> None:
    warnings = coarseness_warnings(*arrays(mesh, scale))
    assert bool(warnings) is warned
    if warned:
        assert "output.subdivide" in warnings[0]


def test_the_share_is_that_of_the_area() -> None:
    cube, rest = RestMesh.of(box(1)), RestMesh.of(torus())
    assert coarse_share(*arrays(join(cube, rest))) == pytest.approx(
        cube.areas.sum() / (cube.areas.sum() + rest.areas.sum())
    )
    assert coarse_share(np.zeros((3, 3)), np.array([[0, 1, 2]])) == 0.0
    assert coarseness_warnings(np.zeros((3, 3)), np.array([[0, 1, 2]])) == ()


# Texture stretch of known deformations.


SIDE = 20


def sheet() -> NDArray[np.float64]:
    """Corners (T, 3, 3) of a square of side 1, in 2 * 20 * 20 triangles."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(SIDE), np.arange(SIDE)))
    corners = [np.stack([i + a, j + b, 0 * i], 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    faces = [np.stack([corners[0], corners[k], corners[k + 1]], 1) for k in (1, 2)]
    return np.concatenate(faces) / SIDE


SHEET = sheet()
TEXELS = SHEET[..., :2] * [256, 128]


def similar(points: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    moved: NDArray[np.float64] = scale * points @ turn.T + [1, 2, 3]
    return moved


def test_percentiles_and_the_share_are_of_the_results_area() -> None:
    """The right tenth of the sheet becomes nine times as wide: 9 of the 18 tenths of the result."""
    bent = SHEET.copy()
    bent[..., 0] = np.where(bent[..., 0] > 0.9, 0.9 + 9 * (bent[..., 0] - 0.9), bent[..., 0])
    found = measure_texture_stretch(SHEET[..., :2], SHEET, bent)
    assert found is not None
    assert found.measured == 1
    scale = 1.8**0.5
    assert [found.p95, found.above_2, found.scale] == pytest.approx([9 / scale, 0.5, scale])
    values, _ = face_stretch(SHEET[..., :2], SHEET, bent)
    assert np.unique(values.round(6)).tolist() == pytest.approx([1 / scale, 9 / scale], abs=1e-6)


def test_the_singular_values_are_those_of_the_maps() -> None:
    rng = np.random.default_rng(1)
    texels, before, after = rng.normal(size=(50, 3, 2)), rng.normal(size=(50, 3, 3)), rng.normal(size=(50, 3, 3))
    values, scale = face_stretch(texels, before, after)
    for k in range(50):
        edges = (texels[k, 1:] - texels[k, 0]).T
        first, second = (np.linalg.svd((p[k, 1:] - p[k, 0]).T @ np.linalg.inv(edges))[1][0] for p in (before, after))
        assert values[k] == pytest.approx(second / first / scale)


def test_only_triangles_with_a_texture_and_an_area_in_it_count() -> None:
    pixels = np.zeros((128, 256, 4), np.uint8)
    corners = SHEET.reshape(-1, 3)
    count = len(corners)
    uvs = corners[:, :2].astype(np.float32)
    uvs[:300] = 0.25  # a palette: 100 triangles show one colour
    paint = np.zeros(count // 3, np.int64)
    paint[100:200] = 1
    look = Appearance(
        np.arange(count),
        np.arange(count).reshape(-1, 3),
        uvs,
        np.ones((count, 4), np.float32),
        paint,
        (Paint(texture=Texture(pixels)), Paint()),
    )
    texels = texel_corners(look)
    np.testing.assert_allclose(texels[300], TEXELS[300], atol=1e-4)
    found = measure_texture_stretch(texels, SHEET, similar(SHEET, 3.0))
    assert found is not None
    assert found.measured == pytest.approx(0.75)
    assert found.p95 == pytest.approx(1, abs=1e-4)
    assert measure_texture_stretch(np.full_like(texels, np.nan), SHEET, SHEET) is None
