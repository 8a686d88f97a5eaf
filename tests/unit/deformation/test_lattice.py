"""The lattice: exact for affine maps, right gradients, one smooth map for all parts, and as local as it should be."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.details_on_faces import pull_of_large_faces
from meshdeform.deformation.lattice import CELLS, MAX_CELLS, Lattice
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.regularizers import STRAINED
from meshdeform.deformation.stand_in import chosen_carrier
from meshdeform.deformation.variables import placed
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.guidance.target import TargetGuide
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.choices import Carrier
from tests.close import assert_close
from tests.meshes import mesh_of
from tests.unit.deformation.worlds import moved, params
from training.shapes import box, torus

F64 = torch.float64


def cart() -> TriangleMesh:
    """A body and four wheels a little below it, of very different triangle sizes."""
    wheels = [moved(icosphere(2), 0.44 * x, -0.26, 0.29 * z, scale=0.12) for x in (-1, 1) for z in (-1, 1)]
    body = mesh_of(verts_of(box(1)) * torch.tensor([0.9, 0.25, 0.6], dtype=F64), faces_of(box(1)))
    return join(body, *wheels)


CART = cart()


def random_stretch(count: int, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.eye(3, dtype=F64) + 0.3 * torch.randn(count, 3, 3, generator=generator, dtype=F64)


def test_every_point_follows_an_affine_map_exactly() -> None:
    lattice = Lattice.around(RestMesh.of(CART))
    weights = lattice.embedding(CART.verts)
    np.testing.assert_allclose(weights @ lattice.nodes, CART.verts, atol=1e-14)
    linear = random_stretch(1)[0].numpy()
    np.testing.assert_allclose(weights @ (lattice.nodes @ linear.T), CART.verts @ linear.T, atol=1e-14)
    with pytest.raises(ValueError, match="not inside"):
        lattice.embedding(np.array([[5.0, 0.0, 0.0]]))


def test_equal_jacobians_give_their_map_about_the_centre_of_mass_and_have_the_known_energy() -> None:
    field = LatticeField(CART)
    assert_close(placed(field), verts_of(CART), atol=1e-12, rtol=0)
    linear = random_stretch(1)[0]
    nodes = field.solve().detach()
    with torch.no_grad():
        field.tensors["cell_jacobians"].copy_(linear.expand_as(field.tensors["cell_jacobians"]))
    centre = torch.from_numpy(RestMesh.of(CART).centre_of_mass())
    assert_close(placed(field), (verts_of(CART) - centre) @ linear.T + centre, atol=1e-10, rtol=0)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0), dtype=F64))[0]
    assert float(field.dirichlet_penalty(nodes @ (turn * torch.linalg.det(turn)).T + 3)) == pytest.approx(0, abs=1e-9)
    stretched = nodes * torch.tensor([2.0, 0.5, 1.0], dtype=F64)
    energy = 4 + 0.25 + 0.25 + 4 + 1 + 1 - 6
    assert float(field.dirichlet_penalty(stretched)) == pytest.approx(STRAINED * math.log1p(energy / STRAINED))


def test_the_gradients_of_the_penalties_are_right() -> None:
    field = LatticeField(join(icosphere(0), moved(icosphere(0), 1.5, 0, 0, scale=0.2)))
    jacobians = field.tensors["cell_jacobians"]
    with torch.no_grad():
        jacobians.copy_(random_stretch(len(field.elements)))
    direction = random_stretch(len(field.elements), 2)
    for penalty in (field.jacobian_penalty, lambda: field.dirichlet_penalty(field.solve())):
        (found,) = torch.autograd.grad(penalty(), jacobians)
        values = []
        for sign in (1, -1):
            with torch.no_grad():
                jacobians += sign * 1e-6 * direction
                values.append(float(penalty()))
                jacobians -= sign * 1e-6 * direction
        assert float((found * direction).sum()) == pytest.approx((values[0] - values[1]) / 2e-6, rel=1e-4)


def test_solid_blocks_get_a_coarser_lattice_and_flat_things_a_fine_one() -> None:
    assert len(Lattice.around(RestMesh.of(box(4))).cells) <= MAX_CELLS
    flat = mesh_of(verts_of(box(4)) * torch.tensor([1.0, 0.001, 1.0], dtype=F64), faces_of(box(4)))
    lattice = Lattice.around(RestMesh.of(flat))
    assert lattice.spacing == pytest.approx(1 / CELLS)
    assert len(lattice.cells) < MAX_CELLS


def test_islands_are_joined() -> None:
    far = join(moved(icosphere(1), 0, 0, 0, scale=0.1), moved(icosphere(1), 5.0, 3.0, 0, scale=0.1))
    field = LatticeField(far)
    with torch.no_grad():
        field.tensors["cell_jacobians"].mul_(2.0)
    gap = placed(field).detach()[-1] - placed(field).detach()[0]
    assert_close(gap, 2 * (verts_of(far)[-1] - verts_of(far)[0]), atol=1e-9, rtol=0)


def test_auto_takes_the_lattice_for_several_parts_only() -> None:
    assert chosen_carrier(Carrier.AUTO, RestMesh.of(torus())) is Carrier.SURFACE
    assert chosen_carrier(Carrier.AUTO, RestMesh.of(CART)) is Carrier.LATTICE
    assert chosen_carrier(Carrier.SURFACE, RestMesh.of(CART)) is Carrier.SURFACE
    unused = mesh_of(torch.cat([verts_of(torus()), torch.zeros(3, 3, dtype=F64)]), faces_of(torus()))
    assert chosen_carrier(Carrier.AUTO, RestMesh.of(unused)) is Carrier.SURFACE


def test_a_run_that_starts_from_a_shape_keeps_its_carrier() -> None:
    guidance = TargetGuide(CART, style=RenderStyle(view_size=16, supersample=1))
    first = Deformation(CART, guidance, params(preset="balanced", steps=1))
    with torch.no_grad():
        first._variables.tensors["cell_jacobians"][:, 1, 1] *= 1.5
    paper = params(preset="paper", steps=1)
    assert paper.carrier is Carrier.SURFACE
    branch = Deformation(CART, guidance, paper, initial=first.checkpoint().tensors)
    assert torch.equal(branch.verts(), first.verts())
    assert branch.cells == first.cells == len(first._variables.elements)
    assert Deformation(CART, guidance, paper).cells is None


# Details on a large face follow its chord, however the map of space bends; what is far off follows the map.


WALL = mesh_of(verts_of(box(1)) * torch.tensor([1.0, 1.0, 0.1], dtype=torch.float64), faces_of(box(1)))


def beam(height: float, width: float = 0.6) -> TriangleMesh:
    """A beam along x, on the front of the wall at z = 0.05 or farther off."""
    scale, place = (torch.tensor(values, dtype=torch.float64) for values in ([width, 0.05, 0.01], [0.0, 0.1, height]))
    return mesh_of(verts_of(box(1)) * scale + place, faces_of(box(1)))


def followed(*parts: TriangleMesh) -> tuple[RestMesh, NDArray[np.float64]]:
    """Return the mesh, and its vertices after its map of space has bent the wall's middle forward."""
    mesh = RestMesh.of(join(*parts))
    lattice = Lattice.around(mesh)
    nodes = lattice.nodes.copy()
    nodes[:, 2] += 0.5 - 2 * (nodes[:, 0] ** 2 + nodes[:, 1] ** 2)
    weights = lattice.embedding(mesh.verts) + pull_of_large_faces(lattice, mesh)
    return mesh, weights @ nodes


def test_a_beam_stays_on_its_wall_whose_chord_leaves_the_map_and_what_is_farther_follows_the_map() -> None:
    mesh, verts = followed(WALL, beam(0.055))
    rest = mesh.verts
    after = verts[-8:, 2] - verts[:8][rest[:8, 2] > 0, 2].mean()
    np.testing.assert_allclose(after, rest[-8:, 2] - 0.05, atol=2e-3)
    mesh, verts = followed(WALL, beam(0.2))
    x, y, z = mesh.verts[-8:].T
    np.testing.assert_allclose(verts[-8:, 2], z + 0.5 - 2 * (x * x + y * y), atol=5e-3)


def test_an_affine_map_is_exact() -> None:
    mesh = RestMesh.of(join(WALL, beam(0.055), beam(0.075, 0.3)))
    lattice = Lattice.around(mesh)
    linear = np.random.default_rng(0).normal(size=(3, 3))
    pulled = pull_of_large_faces(lattice, mesh)
    assert pulled.nnz > 0
    np.testing.assert_allclose(pulled @ (lattice.nodes @ linear), 0, atol=1e-12)
