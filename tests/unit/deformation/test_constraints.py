"""What is kept, mirrored, held by handles and limited in length, on both carriers: exact, with the right gradient."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from meshdeform.deformation.constraints import (
    Constraints,
    HandleConstraint,
    Mirror,
    VertexPlacement,
    find_partners,
    freedom_around,
    surface_distances,
)
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.deformation.stand_in import StandIn
from meshdeform.deformation.variables import JacobianField, Variables, placed
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.requests.choices import Carrier
from tests.cases import each_case
from training.shapes import grid

BALL = RestMesh.of(icosphere(3))
POINTS = BALL.verts
FINE = RestMesh.of(icosphere(5))
CAP = POINTS[:, 1] > 0.5
PARTNERS = find_partners(BALL, 0)
HELD = int(np.argmin(((POINTS - [0.6, -0.8, 0.1]) ** 2).sum(1)))


def variables(carrier: str, mesh: RestMesh = BALL, **constraints: Any) -> Variables:
    given = Constraints(**constraints)
    return JacobianField(mesh, given) if carrier == "surface" else LatticeField(mesh, constraints=given)


def shaken(carried: Variables, size: float = 0.1) -> torch.Tensor:
    """Return the shape after random changes of the variables."""
    (name,) = carried.tensors
    with torch.no_grad():
        carried.tensors[name] += size * torch.randn(
            carried.tensors[name].shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64
        )
    return placed(carried).detach()


def test_distances_along_a_sphere_are_those_of_its_great_circles() -> None:
    found = surface_distances(BALL, np.arange(len(POINTS)) == 0)
    exact = np.arccos(np.clip(POINTS @ POINTS[0], -1, 1))
    assert np.allclose(found, exact, rtol=0.05, atol=1e-9)
    assert np.isinf(surface_distances(BALL, np.arange(len(POINTS)) == 0, limit=1.0)[exact > 1.05]).all()
    two = join(icosphere(1), TriangleMesh(icosphere(1).verts + 5, icosphere(1).faces))
    apart = surface_distances(RestMesh.of(two), np.arange(84) == 0)
    assert np.isfinite(apart[:42]).all()
    assert np.isinf(apart[42:]).all()


def test_pinned_vertices_stay_and_the_others_solve_the_normal_equations() -> None:
    pinned = np.zeros(len(POINTS), bool)
    pinned[:40] = True
    system = PoissonSystem(BALL, pinned)
    field = np.eye(3) + 0.2 * np.random.default_rng(1).normal(size=(len(BALL.faces), 3, 3))
    verts = system.solve(field)
    assert np.array_equal(verts[:40], POINTS[:40])
    weighted = BALL.gradient.T.multiply(np.repeat(BALL.areas, 3)).tocsr()
    rows = weighted @ (BALL.gradient @ verts - field.transpose(0, 2, 1).reshape(-1, 3))
    assert np.abs(rows[40:]).max() < 1e-12
    assert np.abs(rows[:40]).max() > 1e-3


@each_case("carrier", ["surface", "lattice"])
def test_kept_vertices_keep_their_bits_and_the_surface_joins_them_smoothly(carrier: str) -> None:
    carried = variables(carrier, freedom=freedom_around(BALL, CAP, 0.5), falloff=0.5)
    assert np.allclose(placed(carried).detach(), BALL.verts, atol=1e-12)
    with torch.no_grad():
        for tensor in carried.tensors.values():
            tensor *= 1.5
    moved = np.linalg.norm(placed(carried).detach().numpy() - BALL.verts, axis=1)
    assert (moved[CAP] == 0).all()
    distance = surface_distances(BALL, CAP)
    slope = moved / np.maximum(distance, 1e-9)
    near, far = (distance > 0) & (distance < 0.15), distance > 0.5
    # The slope is continuous: it begins at zero. Without a fall-off it would be about the same everywhere.
    assert 0 < slope[near].max() < 0.25 * slope[far].max()
    # Halfway a vertex goes half its way, and a quarter of the way 3/16 - 1/32 of it: Hermite's smooth step.
    quarter = VertexPlacement(BALL, Constraints(np.full(len(POINTS), 0.25))).place(BALL.verts + 1) - BALL.verts
    np.testing.assert_allclose(quarter, 5 / 32, rtol=1e-7)
    assert (shaken(carried, 0.3).numpy()[CAP] == BALL.verts[CAP]).all()


@each_case("carrier", ["surface", "lattice"])
def test_a_handle_reaches_its_place_exactly_and_a_soft_one_its_share(carrier: str) -> None:
    goal = POINTS[HELD] + [0.3, 0.2, 0.1]
    for weight in (1.0, 0.25):
        carried = variables(carrier, handles=[HandleConstraint((HELD,), (1.0,), goal, weight)])
        way = placed(carried).detach().numpy()[HELD] - POINTS[HELD]
        assert np.allclose(way, weight * (goal - POINTS[HELD]), atol=1e-9)
        if weight == 1.0:
            assert np.allclose(shaken(carried).numpy()[HELD], goal, atol=1e-9)
    # A point within a face, together with one that stays.
    face, shares = BALL.faces[7], (0.2, 0.3, 0.5)
    goals = [goal, shares @ POINTS[face]]
    both = [HandleConstraint((HELD,), (1.0,), goals[0]), HandleConstraint(tuple(face.tolist()), shares, goals[1])]
    found = shaken(variables(carrier, handles=both)).numpy()
    assert np.allclose([found[HELD], shares @ found[face]], goals, atol=1e-9)


def test_handles_that_cannot_reach_their_places_are_refused() -> None:
    pole, side = int(POINTS[:, 1].argmax()), int(np.abs(POINTS[:, 0]).argmin())
    there = (1.0,), np.array([9.0, 0.0, 0.0])
    with pytest.raises(ParameterError, match="handle 0 cannot move along x"):
        variables("surface", freedom=freedom_around(BALL, CAP, 0.5), handles=[HandleConstraint((pole,), *there)])
    with pytest.raises(ParameterError, match="handle 0 cannot move along x"):
        variables("surface", mirror=Mirror.of_partners(PARTNERS), handles=[HandleConstraint((side,), *there)])
    with pytest.raises(ParameterError, match="handles 0 and 1 hold one point"):
        variables("lattice", handles=[HandleConstraint((HELD,), *there), HandleConstraint((HELD,), *there)])


@each_case("carrier", ["surface", "lattice"])
def test_a_symmetric_mesh_stays_symmetric_to_the_last_bit_of_its_displacements(carrier: str) -> None:
    assert PARTNERS.unmatched == 0
    bent = RestMesh(BALL.verts + 0.05 * BALL.verts[:, :1] ** 2 * np.array([1.0, 0.0, 0.0]), BALL.faces)
    assert find_partners(bent, 0).unmatched > 100
    assert find_partners(bent, 2).unmatched == 0
    moved = shaken(variables(carrier, mirror=Mirror.of_partners(PARTNERS))).numpy() - BALL.verts
    assert np.array_equal(moved, moved[PARTNERS.partner] * [-1, 1, 1])
    assert (moved[PARTNERS.partner == np.arange(len(moved)), 0] == 0).all()
    assert np.abs(moved).max() > 1e-3


@each_case("carrier", ["surface", "lattice"])
def test_the_gradient_is_right_with_all_constraints_at_once(carrier: str) -> None:
    small = RestMesh.of(icosphere(1))
    points = small.verts
    cap = points[:, 1] > 0.8
    held, other = (int(np.argmin(((points - at) ** 2).sum(1))) for at in ([0.6, -0.8, 0.1], [0.5, -0.2, -0.8]))
    carried = variables(
        carrier,
        small,
        freedom=freedom_around(small, cap, 0.6),
        falloff=0.6,
        mirror=Mirror.of_partners(find_partners(small, 0)),
        handles=[
            HandleConstraint((held,), (1.0,), points[held] + [0.1, 0.0, 0.1]),
            HandleConstraint((other,), (1.0,), points[other], 0.5),
        ],
    )
    shaken(carried)
    ((name, tensor),) = carried.tensors.items()
    generator = torch.Generator().manual_seed(2)
    weights = torch.randn(points.shape, generator=generator, dtype=torch.float64)
    (placed(carried) * weights).sum().backward()
    start = tensor.detach().clone()
    for _ in range(5):
        way = torch.randn(tensor.shape, generator=generator, dtype=torch.float64)
        ends = []
        for step in (1e-6, -1e-6):
            with torch.no_grad():
                tensor.copy_(start + step * way)
                ends.append(float((placed(carried) * weights).sum()))
        assert tensor.grad is not None
        assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(float((tensor.grad * way).sum()), rel=1e-6, abs=1e-8), name


@each_case("carrier", [Carrier.SURFACE, Carrier.LATTICE])
def test_the_whole_of_a_large_mesh_keeps_its_bits_too(carrier: Carrier) -> None:
    whole = FINE
    points = whole.verts
    cap = points[:, 1] > 0.5
    partners = find_partners(whole, 0)
    constraints = Constraints(freedom_around(whole, cap, 0.5), 0.5, Mirror.of_partners(partners))
    stand_in = StandIn(whole, constraints=constraints)
    assert len(stand_in.mesh.faces) < len(whole.faces)
    carried = stand_in.carry(carrier)
    shaken(carried, 0.3)
    found = stand_in.follow(carried).detach().numpy()
    moved = found - points
    assert (moved[cap] == 0).all()
    assert np.abs(moved).max() > 0.01
    assert np.abs(moved - moved[partners.partner] * [-1, 1, 1]).max() < 1e-12


def test_a_lattice_that_is_pinned_everywhere_is_refused() -> None:
    flat = RestMesh.of(grid(4, 4))
    kept = np.ones(len(flat.verts), bool)
    kept[12] = False
    field = LatticeField(flat, constraints=Constraints(freedom_around(flat, kept, 0.0), 0.0))
    assert np.array_equal(shaken(field)[:12], flat.verts[:12])
    with pytest.raises(ParameterError, match="the lattice cannot move anything"):
        LatticeField(flat, constraints=Constraints(np.zeros(len(flat.verts))))


@each_case("edge, freedom, falloff", [
    (0.05, [0.0, 0.5, 1.0, 1.0], 0.1),  # two edges are the whole way, which the stand-in has gone already
    (0.4, [0.0, 0.0625, 0.25, 1.0], 0.8),  # never longer than the fall-off itself
    (0.0, [0.0, 0.0625, 0.25, 1.0], 0.0),
])  # fmt: skip
def test_what_follows_a_stand_in_falls_off_over_two_of_its_edges(
    edge: float, freedom: list[float], falloff: float
) -> None:
    given = Constraints(freedom=np.array([0.0, 0.0625, 0.25, 1.0]), falloff=0.8)
    followers = given.of_followers(edge)
    np.testing.assert_allclose(followers.freedom, freedom)
    assert followers.falloff == pytest.approx(falloff)
