"""Tips of slivers follow the edges on which they lie."""

from __future__ import annotations

import numpy as np

from meshdeform.geometry.slivers import along_slivers

# A triangle whose first edge has a sliver beside it: the tip lies a thousandth inside.
REST = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.4, 0.001, 0], [3, 3, 0]])
FACES = np.array([[0, 1, 3], [1, 2, 3], [2, 0, 3]])


def test_a_tip_goes_where_its_edge_has_gone() -> None:
    bent = REST + np.array([[0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, 5], [0, 0, 2.0]])
    placed = along_slivers(REST, FACES, bent)
    np.testing.assert_array_equal(placed[[0, 1, 2, 4]], bent[[0, 1, 2, 4]])
    np.testing.assert_allclose(placed[3], [0.4, 0.001, 0.4], atol=1e-12)


def test_an_affine_map_stays_what_it_is() -> None:
    affine = REST @ np.array([[2.0, 0.3, 0], [0, 1, 0.5], [1, 0, 3]]) + [1, 2, 3]
    np.testing.assert_allclose(along_slivers(REST, FACES, affine), affine, atol=1e-12)


def test_what_has_no_sliver_or_nothing_behind_it_stays() -> None:
    bent = REST + np.random.default_rng(0).normal(size=REST.shape)
    for faces in (FACES[:1], FACES[1:], np.array([[0, 1, 2]]), np.array([[0, 0, 1], [1, 2, 1]])):
        np.testing.assert_array_equal(along_slivers(REST, faces, bent), bent)
