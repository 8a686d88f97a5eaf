"""Scalars on a base: learned from half of the places, compared at the others; their file, and the .ndf."""

from __future__ import annotations

import io

import numpy as np
import pytest

from meshdeform.errors import AssetError
from meshdeform.geometry.shapes import icosphere
from meshdeform.kinds.surface_fit.container import encode_base, write_field
from meshdeform.kinds.surface_fit.learned_scalars import check_places, learned_scalars, places_on
from meshdeform.kinds.surface_fit.network import FieldNetwork
from meshdeform.kinds.surface_fit.patches import level_of
from meshdeform.kinds.surface_fit.reader import NeuralField, read_field
from meshdeform.kinds.surface_fit.scalar_fields import learn_scalars
from meshdeform.kinds.surface_fit.scalar_files import read_scalar_file
from meshdeform.kinds.surface_fit.scalar_sections import read_scalars


@pytest.fixture(scope="module")
def places() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A coarse sphere: its vertices, and corners, weights and positions of places on it."""
    mesh = icosphere(1)
    level = level_of(mesh.faces, len(mesh.verts), 3)
    points = np.einsum("pk,pkc->pc", level.weights, mesh.verts[level.corners])
    return mesh.verts, level.corners, level.weights, points / np.linalg.norm(points, axis=1, keepdims=True)


def test_harmonics_are_learned_from_half_of_the_places(
    places: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> None:
    verts, corners, weights, points = places
    x, y, z = points.T
    wanted = np.stack([100 + 5 * z, x * y, x, y, y * z, x * z, x**2 - y**2, 3 * z**2 - 1], 1)
    half = np.random.default_rng(0).permutation(len(points))
    known, other = np.split(half, [len(half) // 2])
    field = learn_scalars(verts, corners[known], weights[known], wanted[known], steps=300)
    apart = field.values(corners[other], weights[other]) - wanted[other]
    assert (np.sqrt((apart**2).mean(0)) < 0.05 * wanted.std(0)).all()
    assert sum(tensor.numel() for tensor in field.tensors) < 3000


def flat_field(*, scalars: bool = True) -> tuple[NeuralField, np.ndarray, np.ndarray]:
    """Return a sphere's field that displaces nothing, with what was learned on it, and points with their halves."""
    mesh = icosphere(2)
    base = encode_base(mesh.verts, mesh.faces)
    network = FieldNetwork.random(len(base.verts), 1, 0, 4, 1, 0)
    network = FieldNetwork(network.features, [(w * 0, b) for w, b in network.layers], 0)
    place = {"centre": np.array([5.0, 0.0, 0.0]), "scale": 2.0}
    bare = read_field(write_field(base, network, **place))
    points = icosphere(4).verts
    half = np.where(points @ [0.6, 0.8, 0.0] > 0.1, 7, -2)
    file = io.BytesIO()
    np.savez(file, points=5 * np.eye(3)[0] + 2 * points, normals=3 * points, height=10 * points[:, 2], side=half)
    if not scalars:
        return bare, points, half
    fields, facts = learned_scalars(bare, read_scalar_file(file.getvalue()), steps=200)
    assert facts[0]["relative_error"] < 0.05
    assert facts[1]["share_wrong"] < 0.02
    return read_field(write_field(base, network, **place, scalars=fields)), points, half


def test_what_was_learned_at_points_is_read_from_the_field() -> None:
    field, points, half = flat_field()
    corners, weights = places_on(field, 5 * np.eye(3)[0] + 2 * points, points)
    height, side = read_scalars(field)
    assert (height.name, height.labels, side.name, side.labels) == ("height", [], "side", [-2, 7])
    apart = height.values(corners, weights)[:, 0] - 10 * points[:, 2]
    assert np.sqrt((apart**2).mean()) < 0.4
    assert (side.pieces(corners, weights) == half).mean() > 0.98
    # Nothing else of the file is changed by them.
    bare = flat_field(scalars=False)[0]
    assert read_scalars(bare) == []
    assert np.array_equal(bare.unfold(1)[0], field.unfold(1)[0])
    field.more[0] = field.more[0][:-1]
    with pytest.raises(ValueError, match="contradicts itself"):
        read_scalars(field)


def npz(**arrays: object) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def test_scalars_that_fit_nothing_are_refused_with_the_reason() -> None:
    points = np.random.default_rng(0).normal(size=(200, 3))
    for data, said in (
        (b"nothing", "cannot be read"),
        (npz(height=points[:, 0]), "no 'points'"),
        (npz(points=points[:, :2]), r"must be \(P, 3\)"),
        (npz(points=points), "no scalars"),
        (npz(points=points[:50], height=points[:50, 0]), "100 are needed"),
        (npz(points=points, height=points[:5, 0]), r"'height' is float64 \(5,\)"),
        (npz(points=points, height=np.full(200, np.nan)), "not finite"),
        (npz(points=points, height=np.full(200, 1e300)), "32-bit"),
        (npz(points=points * 1e300, height=points[:, 0]), "32-bit"),
        (npz(points=points, side=np.zeros((200, 2), int)), "integers"),
        (npz(points=points, side=np.arange(200)), "200 scalars and pieces"),
        (npz(points=points, normals=points[:9], height=points[:, 0]), "9 normals"),
        (npz(points=points, **{"<b>": points[:, 0]}), "the name '<b>'"),
    ):
        with pytest.raises(AssetError, match=said):
            read_scalar_file(data)
    ball = icosphere(1)
    near = read_scalar_file(npz(points=ball.verts.repeat(3, 0), height=np.zeros(126)))
    check_places(ball.verts, ball.faces, near)
    far = read_scalar_file(npz(points=ball.verts.repeat(3, 0) + 1, height=np.zeros(126)))
    with pytest.raises(AssetError, match="elsewhere"):
        check_places(ball.verts, ball.faces, far)
