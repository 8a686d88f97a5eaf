"""Thousands of one thing in one place: the same answers, without looking at all of them."""

from __future__ import annotations

import numpy as np

from meshdeform.geometry.copies import first_alike
from meshdeform.geometry.nearest_points import SurfaceTree
from meshdeform.geometry.shapes import icosphere
from meshdeform.rendering.visibility import nearest_faces

COPIES = 400


def test_the_first_of_equal_rows_remains() -> None:
    rows = np.random.default_rng(3).integers(-2, 3, (500, 3))
    found = first_alike(rows)
    assert len(np.unique(rows, axis=0)) == len(found)
    seen: set[tuple[int, ...]] = set()
    assert found.tolist() == [k for k, row in enumerate(map(tuple, rows)) if row not in seen and not seen.add(row)]  # type: ignore[func-returns-value]


def test_the_nearest_places_on_copies_are_those_on_one() -> None:
    mesh = icosphere(1)
    verts, faces = mesh.verts, mesh.faces
    random = np.random.default_rng(1)
    points = random.normal(size=(50, 3))
    face, weights = SurfaceTree.of(verts, faces).find(points, np.zeros_like(points))
    apart, own = np.concatenate([verts] * COPIES), np.concatenate([faces + k * len(verts) for k in range(COPIES)])
    for many, all_faces in (
        (verts, np.tile(faces, (COPIES, 1))),
        (apart, own),
        (apart + random.uniform(-1e-9, 1e-9, apart.shape), own),
    ):
        tree = SurfaceTree.of(many, all_faces)
        assert tree._tree.n < 10 * len(verts) * 6
        found, of_copy = tree.find(points, np.zeros_like(points))
        np.testing.assert_allclose(
            np.einsum("pk,pkc->pc", of_copy, many[all_faces[found]]),
            np.einsum("pk,pkc->pc", weights, verts[faces[face]]),
            atol=1e-8,
        )


def test_a_picture_of_copies_is_that_of_the_first() -> None:
    mesh = icosphere(1)
    verts, faces = mesh.verts, mesh.faces
    clip = np.concatenate([verts, np.full((len(verts), 1), 2.0)], 1)[None]
    one, depth = nearest_faces(clip, faces, 24, 24)
    many, depth_of_many = nearest_faces(clip, np.tile(faces, (COPIES, 1)), 24, 24)
    np.testing.assert_array_equal(many, one)
    np.testing.assert_array_equal(depth_of_many, depth)
