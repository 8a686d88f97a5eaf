"""Normals and tangents without a direction are rebuilt from the surface, counted, and written."""

from __future__ import annotations

import numpy as np

from meshdeform.assets import load_asset
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_TANGENTS, QUAD_VERTS, Builder, notable, quad
from tests.unit.assets.test_replace import position

FLAT = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
UVS = np.float32([[0, 1], [1, 1], [0, 0], [1, 0]])  # upright: v grows downwards


def damaged(bad: float, *, uvs: bool = True) -> Builder:
    normals, tangents = np.tile(np.float32([0.6, 0, 0.8]), (4, 1)), np.tile(np.float32([0.8, 0, -0.6, -1]), (4, 1))
    normals[1], normals[2, 0], tangents[1], tangents[3, 3] = bad, np.inf, bad, np.nan
    builder = Builder()
    texture = {"TEXCOORD_0": UVS} if uvs else {}
    primitive = builder.primitive(FLAT, QUAD_FACES, NORMAL=normals, TANGENT=tangents, **texture)
    builder.node(builder.mesh(primitive), scale=[2, 2, 2])
    return builder


@each_case("bad", [np.nan, -np.inf, 0.0])
@each_case("uvs", [True, False])
def test_rows_without_a_direction_are_rebuilt_and_the_others_kept(bad: float, uvs: bool) -> None:
    asset = load_asset(damaged(bad, uvs=uvs).glb())
    surface = asset.surface
    written = asset.replace(surface.positions, surface.normals, surface.tangents)
    normals, tangents = position(written, name="NORMAL"), position(written, name="TANGENT")
    np.testing.assert_array_equal(normals[[0, 3]], np.float32([[0.6, 0, 0.8]] * 2))
    np.testing.assert_allclose(normals[[1, 2]], [[0, 0, 1]] * 2, atol=1e-7)
    np.testing.assert_array_equal(tangents[[0, 2]], np.float32([[0.8, 0, -0.6, -1]] * 2))
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose((tangents[1, :3] * normals[1]).sum(), 0.0, atol=1e-6)
    if uvs:
        np.testing.assert_allclose(tangents[1], [1, 0, 0, 1], atol=1e-6)
        np.testing.assert_allclose(tangents[3], [0.8, 0, -0.6, 1], atol=1e-6)  # along u, and upright
    assert (asset.repairs.normals, asset.repairs.tangents) == (2, 2)
    assert "2 normals and 2 tangents" in asset.summary.warnings[0]


def test_every_normal_has_a_direction_then_and_a_good_file_is_left_alone() -> None:
    asset = load_asset(damaged(np.nan).glb())
    surface = asset.surface
    morph = asset.replace(surface.positions + 1, surface.normals, surface.tangents, morph=True)
    assert np.isfinite(position(morph, name="NORMAL")).all()
    assert np.isfinite(position(morph, name="TANGENT")).all()
    assert load_asset(morph).repairs.normals == 0
    builder = Builder()
    normals = np.vstack([QUAD_NORMALS, [[np.nan] * 3]]).astype(np.float32)
    verts = np.vstack([QUAD_VERTS, [[7, 7, 7]]])
    builder.node(builder.mesh(builder.primitive(verts, QUAD_FACES, NORMAL=normals)))
    assert np.isfinite(load_asset(builder.glb()).surface.normals).all()
    asset = load_asset(quad())
    assert (asset.repairs.normals, notable(asset)) == (0, ())
    np.testing.assert_array_equal(position(asset.replace(asset.surface.positions), name="TANGENT"), QUAD_TANGENTS)
