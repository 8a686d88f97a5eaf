"""Rigid bodies: they keep their shape exactly, the gradient is right, and the rest is as without them."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.deformation.constraints import RigidBody
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.rigid_bodies import RigidBodies
from meshdeform.deformation.stand_in import carry, chosen_carrier
from meshdeform.deformation.surface_guard import SurfaceGuard
from meshdeform.deformation.variables import Adam, placed
from meshdeform.geometry.intersections import cutting_pairs
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.tensors import verts_of
from meshdeform.requests.choices import Carrier, Rigidity
from meshdeform.requests.document import Safeguard
from tests.cases import each_case
from tests.close import assert_close
from tests.meshes import mesh_of
from tests.unit.deformation.worlds import moved
from training.shapes import box, torus

F64 = torch.float64
RIGID, SIMILARITY = Rigidity.RIGID, Rigidity.SIMILARITY


WHEELS = [moved(torus(n=12, m=8), 0.5 * x, -0.3, 0.0, scale=0.15) for x in (-1, 1)]
CART = RestMesh.of(join(moved(icosphere(2), 0, 0.3, 0, scale=0.5), *WHEELS))
FREE, LEFT, RIGHT = (np.flatnonzero(CART.components == number) for number in range(3))
BODIES = [RigidBody(LEFT, RIGID), RigidBody(RIGHT, SIMILARITY)]


def lengths(points: Tensor) -> Tensor:
    return torch.cdist(points, points, compute_mode="donot_use_mm_for_euclid_dist")


def bent(field: LatticeField, seed: int = 0) -> LatticeField:
    """Set random smooth Jacobians."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        field.tensors["cell_jacobians"] += 0.4 * torch.randn(
            field.tensors["cell_jacobians"].shape, generator=generator, dtype=F64
        )
        field.tensors["cell_jacobians"] *= 1.2
    return field


def test_bodies_keep_their_shape_and_everything_else_is_as_without_them() -> None:
    plain, held = placed(bent(LatticeField(CART))).detach(), placed(bent(LatticeField(CART, bodies=BODIES))).detach()
    rest = verts_of(CART)
    assert float((lengths(plain[LEFT]) - lengths(rest[LEFT])).abs().max()) > 0.01
    assert_close(lengths(held[LEFT]), lengths(rest[LEFT]), atol=1e-12, rtol=0)
    ratio = lengths(held[RIGHT])[0, 1:] / lengths(rest[RIGHT])[0, 1:]
    assert_close(ratio, ratio[:1].expand_as(ratio), atol=1e-12, rtol=0)
    assert float(ratio[0]) == pytest.approx(1.2, abs=0.1)
    assert torch.equal(held[FREE], plain[FREE])
    # Each body is where the lattice puts it: no other motion is closer, not even by a little.
    areas = torch.from_numpy(CART.vertex_areas)
    for verts in (LEFT, RIGHT):
        weights = areas[verts][:, None]
        assert_close((weights * held[verts]).sum(0), (weights * plain[verts]).sum(0), atol=1e-12, rtol=0)
        error = (weights * (held[verts] - plain[verts]) ** 2).sum()
        arms = held[verts] - (weights * held[verts]).sum(0) / weights.sum()
        for axis in torch.eye(3, dtype=F64):
            turn = torch.linalg.matrix_exp(0.01 * torch.linalg.cross(axis.expand(3, 3), torch.eye(3, dtype=F64)))
            turned = held[verts] - arms + arms @ turn
            assert (weights * (turned - plain[verts]) ** 2).sum() > error


@each_case("mode", [RIGID, SIMILARITY])
@each_case("shape", ["round", "flat", "line", "point"])
def test_the_gradient_is_that_of_finite_differences(mode: Rigidity, shape: str) -> None:
    """Also for bodies whose singular vectors have no derivative: of revolution, flat, on a line, a single point."""
    ring = torch.linspace(0, 2 * torch.pi, 13, dtype=F64)[:-1]
    flat = torch.stack([ring.cos(), ring.sin(), 0 * ring], 1)
    line = torch.stack([ring, 0 * ring, 0 * ring], 1)
    points = {"round": verts_of(torus(n=12, m=8)), "flat": flat, "line": line, "point": flat[:1]}[shape]
    faces = torch.arange(len(points) // 3 * 3).view(-1, 3)
    mesh = RestMesh.of(mesh_of(torch.cat([points, torch.ones(3, 3, dtype=F64)]), faces))
    bodies = RigidBodies(mesh, [RigidBody(np.arange(len(points)), mode)])
    generator = torch.Generator().manual_seed(3)
    start, step, probe = (torch.randn(verts_of(mesh).shape, generator=generator, dtype=F64) for _ in range(3))
    if shape == "line":  # across a line nothing is determined but by the tie-break, which is stiff
        start, step = start * torch.tensor([1.0, 0, 0]), step * torch.tensor([1.0, 0, 0])
    at = (verts_of(mesh) + 0.1 * start).requires_grad_()
    (found,) = torch.autograd.grad((bodies.place(at) * probe).sum(), at)

    def value(by: float) -> float:
        return float((bodies.place(at.detach() + by * step) * probe).sum())

    expected = (8 * (value(1e-3) - value(-1e-3)) - (value(2e-3) - value(-2e-3))) / 12e-3
    assert float((found * step).sum()) == pytest.approx(expected, rel=1e-6, abs=1e-8)


def test_a_body_is_not_mirrored_and_bodies_do_not_share_vertices() -> None:
    mirrored = verts_of(CART) * torch.tensor([-1.0, 1, 1])
    placed_there = RigidBodies(CART, BODIES[:1]).place(mirrored)
    before, after = (points[LEFT[[0, 5, 30, 50]]] for points in (verts_of(CART), placed_there))
    assert float(torch.linalg.det(before[1:] - before[0]) * torch.linalg.det(after[1:] - after[0])) > 0
    with pytest.raises(ValueError, match="share"):
        RigidBodies(CART, [RigidBody(LEFT), RigidBody(LEFT[:1])])


def test_rigid_bodies_choose_the_lattice() -> None:
    ball = RestMesh.of(icosphere(1))
    assert chosen_carrier(Carrier.AUTO, ball) is Carrier.SURFACE
    assert chosen_carrier(Carrier.AUTO, ball, rigid=True) is Carrier.LATTICE
    with pytest.raises(ValueError, match="lattice"):
        carry(Carrier.SURFACE, ball, bodies=[RigidBody(np.arange(10))])


def test_a_body_may_come_to_cut_what_is_within_half_a_cell_of_it() -> None:
    """Space is pressed to half its height, and a ball below a box is not: it runs into the box."""
    for gap, free in ((0.01, True), (0.06, False)):
        mesh = RestMesh.of(join(box(4), moved(icosphere(2), 0, -0.6 - gap, 0, scale=0.1)))
        ball = np.flatnonzero(mesh.components == 1)
        field = LatticeField(mesh, bodies=[RigidBody(ball, RIGID)])
        guard = SurfaceGuard(Safeguard.INTERSECTIONS, mesh, field)
        jacobians = field.tensors["cell_jacobians"]
        with torch.no_grad():
            jacobians[:, 1, 1] = 0.5
        assert len(cutting_pairs(placed(field).detach().numpy(), mesh.faces)) > 0
        assert (guard.correct(Adam([{"params": [jacobians], "lr": 1.0}])) == 0) == free
