"""Scalars on a base: learned from half of the places, compared at the others; their file."""

from __future__ import annotations

import numpy as np
import pytest
from safetensors.numpy import save

from meshdeform.fields.patches import level_of
from meshdeform.fields.scalar_fields import ScalarField, learn_scalars
from meshdeform.geometry.shapes import icosphere


@pytest.fixture(scope="module")
def places() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A coarse sphere: its vertices, and corners, weights and positions of places on it."""
    mesh = icosphere(1)
    level = level_of(mesh.faces.numpy(), len(mesh.verts), 3)
    points = np.einsum("pk,pkc->pc", level.weights, mesh.verts.numpy()[level.corners])
    return mesh.verts.numpy(), level.corners, level.weights, points / np.linalg.norm(points, axis=1, keepdims=True)


def test_harmonics_are_learned_from_half_of_the_places(
    places: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> None:
    verts, corners, weights, points = places
    wanted = np.stack([100 + 5 * points[:, 2], points[:, 0] * points[:, 1]], 1)
    half = np.random.default_rng(0).permutation(len(points))
    known, other = np.split(half, [len(half) // 2])
    field = learn_scalars(verts, corners[known], weights[known], wanted[known], steps=300)
    read = ScalarField.read(field.data(), len(verts))
    apart = read.values(corners[other], weights[other]) - wanted[other]
    assert (np.sqrt((apart**2).mean(0)) < 0.05 * wanted.std(0)).all()
    assert len(field.data()) < 6000


def test_a_piece_is_told_from_the_rest(places: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]) -> None:
    verts, corners, weights, points = places
    inside = (points @ [0.6, 0.8, 0.0] > 0.2)[:, None]
    field = learn_scalars(verts, corners, weights, inside.astype(float), classes=True, steps=150)
    assert ((field.values(corners, weights) > 0) == inside).mean() > 0.98


def test_what_is_no_scalar_field_of_the_base_is_refused(
    places: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> None:
    verts, corners, weights, points = places
    data = ScalarField.random(verts, 1).data()
    with pytest.raises(ValueError, match="base of 42 vertices, not of 43"):
        ScalarField.read(data, 43)
    with pytest.raises(ValueError, match="damaged"):
        ScalarField.read(data[:-9], 42)
    with pytest.raises(ValueError, match="not a scalar field"):
        ScalarField.read(save({"x": np.zeros(3)}), 42)
    bad = {"features": np.zeros((42, 8), np.float16), "layers.0.weight": np.zeros((1, 9), np.float16)}
    with pytest.raises(ValueError, match="Layer 0"):
        ScalarField.read(save(bad), 42)
    with pytest.raises(ValueError, match="finite"):
        learn_scalars(verts, corners, weights, np.full((len(points), 1), np.nan))
    with pytest.raises(ValueError, match="as many places"):
        learn_scalars(verts, corners, weights, points[:5])
