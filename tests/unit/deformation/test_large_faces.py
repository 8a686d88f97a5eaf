"""Details on a large face follow its chord, however the map of space bends; what is far off follows the map."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.deformation.large_faces import pull_of_large_faces
from meshdeform.deformation.lattice import Lattice
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import box, join

WALL = TriangleMesh(box(1).verts * torch.tensor([1.0, 1.0, 0.1], dtype=torch.float64), box(1).faces)


def beam(height: float, width: float = 0.6) -> TriangleMesh:
    """A beam along x, on the front of the wall at z = 0.05 or farther off."""
    scale, place = (torch.tensor(values, dtype=torch.float64) for values in ([width, 0.05, 0.01], [0.0, 0.1, height]))
    return TriangleMesh(box(1).verts * scale + place, box(1).faces)


def followed(*parts: TriangleMesh) -> tuple[RestMesh, NDArray[np.float64]]:
    """Return the mesh, and its vertices after its map of space has bent the wall's middle forward."""
    mesh = RestMesh.of(join(*parts))
    lattice = Lattice.around(mesh)
    nodes = lattice.nodes.copy()
    nodes[:, 2] += 0.5 - 2 * (nodes[:, 0] ** 2 + nodes[:, 1] ** 2)
    weights = lattice.embedding(mesh.verts.numpy()) + pull_of_large_faces(lattice, mesh)
    return mesh, weights @ nodes


def test_a_beam_stays_on_its_wall_whose_chord_leaves_the_map() -> None:
    mesh, verts = followed(WALL, beam(0.055))
    before, after = (
        mesh.verts.numpy()[-8:, 2] - 0.05,
        verts[-8:, 2] - verts[:8][mesh.verts.numpy()[:8, 2] > 0, 2].mean(),
    )
    np.testing.assert_allclose(after, before, atol=2e-3)


def test_what_is_farther_than_a_cell_follows_the_map() -> None:
    mesh, verts = followed(WALL, beam(0.2))
    x, y, z = mesh.verts.numpy()[-8:].T
    expected = z + 0.5 - 2 * (x * x + y * y)
    np.testing.assert_allclose(verts[-8:, 2], expected, atol=5e-3)


def test_what_lies_on_a_beam_on_a_wall_follows_both() -> None:
    knob = TriangleMesh(box(1).verts * 0.01 + torch.tensor([0.0, 0.1, 0.065], dtype=torch.float64), box(1).faces)
    mesh, verts = followed(WALL, beam(0.055), knob)
    rest = mesh.verts.numpy()
    np.testing.assert_allclose(verts[-8:, 2] - verts[8:16, 2].mean(), rest[-8:, 2] - rest[8:16, 2].mean(), atol=2e-3)


def test_an_affine_map_is_exact() -> None:
    mesh = RestMesh.of(join(WALL, beam(0.055), beam(0.075, 0.3)))
    lattice = Lattice.around(mesh)
    linear = np.random.default_rng(0).normal(size=(3, 3))
    pulled = pull_of_large_faces(lattice, mesh)
    assert pulled.nnz > 0
    np.testing.assert_allclose(pulled @ (lattice.nodes @ linear), 0, atol=1e-12)
