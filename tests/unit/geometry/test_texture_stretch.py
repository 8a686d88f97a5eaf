"""Texture stretch of known deformations."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.geometry.appearance import Appearance, Paint, Texture
from meshdeform.geometry.quality import face_stretch, measure_texture_stretch, texel_corners
from tests.cases import each_case

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


@each_case("scale", [1.0, 2.0, 0.1])
def test_a_similarity_has_1(scale: float) -> None:
    found = measure_texture_stretch(TEXELS, SHEET, similar(SHEET, scale))
    assert found is not None
    assert [found.p50, found.p95, found.above_2, found.scale, found.measured] == pytest.approx([1, 1, 0, scale, 1])


def test_texels_drawn_out_sixfold_in_one_direction() -> None:
    """The square texels of a sheet become six times as high; its area grows sixfold, so s is the root of 6."""
    found = measure_texture_stretch(SHEET[..., :2], SHEET, SHEET * [1, 6, 1])
    assert found is not None
    assert [found.p50, found.p95, found.above_2, found.scale] == pytest.approx([6**0.5, 6**0.5, 1, 6**0.5])


def test_percentiles_and_the_share_are_of_the_results_area() -> None:
    """The right tenth of the sheet becomes nine times as wide: 9 of the 18 tenths of the result."""
    bent = SHEET.copy()
    bent[..., 0] = np.where(bent[..., 0] > 0.9, 0.9 + 9 * (bent[..., 0] - 0.9), bent[..., 0])
    found = measure_texture_stretch(SHEET[..., :2], SHEET, bent)
    assert found is not None
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
