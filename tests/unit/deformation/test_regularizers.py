"""The penalties mean the same at every resolution and scale, and their gradients survive bad faces."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.deformation.poisson import completed_jacobians, identity_jacobians
from meshdeform.deformation.regularizers import Regularizers
from meshdeform.geometry.mesh import TriangleMesh, edges_of, face_normals
from meshdeform.geometry.shapes import box, grid, icosphere, join, torus, uv_sphere
from tests.cases import each_case
from tests.close import assert_close

F64 = torch.float64


def smooth(verts: Tensor) -> Tensor:
    """A smooth map of space: stretched, bent and twisted a little."""
    x, y, z = (verts * torch.tensor([1.0, 1.3, 0.8], dtype=F64)).unbind(1)
    return torch.stack([x + 0.2 * torch.sin(1.5 * y), y + 0.1 * x * z, z - 0.15 * torch.cos(2 * x)], 1)


def penalties(mesh: TriangleMesh, verts: Tensor) -> dict[str, float]:
    regularizers = Regularizers(mesh)
    jacobians = completed_jacobians(mesh, verts)
    return {
        "jacobian": float(regularizers.jacobian(jacobians)),
        "laplacian": float(regularizers.laplacian(verts)),
        "normal": float(regularizers.normal(verts)),
    }


def test_resolution_does_not_matter() -> None:
    values = [penalties(mesh, smooth(mesh.verts)) for mesh in (icosphere(3), icosphere(4), icosphere(5))]
    for name in values[0]:
        assert values[0][name] == pytest.approx(values[2][name], rel=0.06), name
        assert values[1][name] == pytest.approx(values[2][name], rel=0.02), name


@each_case("unit", [1e-3, 50.0])
def test_scale_does_not_matter(unit: float) -> None:
    mesh = icosphere(2)
    scaled = TriangleMesh(mesh.verts * unit, mesh.faces)
    assert penalties(scaled, smooth(mesh.verts) * unit) == pytest.approx(penalties(mesh, smooth(mesh.verts)), rel=1e-9)


def test_the_rest_mesh_costs_no_jacobian_and_no_laplacian_whatever_its_detail() -> None:
    mesh = join(box(3), icosphere(2), grid(3))
    values = penalties(mesh, mesh.verts)
    assert values["jacobian"] < 1e-20
    assert values["laplacian"] < 1e-20


def test_the_jacobian_term_is_the_mean_of_a_constant() -> None:
    mesh = icosphere(1)
    stretched = torch.diag(torch.tensor([2.0, 1.0, 0.5], dtype=F64)).expand(len(mesh.faces), 3, 3)
    assert float(Regularizers(mesh).jacobian(stretched)) == pytest.approx(1.25)


def test_the_laplacian_term_of_a_sphere_that_grows_is_known() -> None:
    """For u = c x on the unit sphere Delta u = -2 c x, so the integral of its square over 4 pi is 4 c^2."""
    mesh = icosphere(4)
    assert float(Regularizers(mesh).laplacian(1.3 * mesh.verts)) == pytest.approx(4 * 0.09, rel=0.01)


def test_the_laplacian_term_does_not_see_a_shear_inside_a_plane() -> None:
    """A linear displacement bends nothing inside: beside it a bump costs what it costs alone."""
    mesh = grid(40, 2.0)
    regularizers = Regularizers(mesh)
    x, y = mesh.verts[:, 0], mesh.verts[:, 1]
    height = ((0.81 - x**2) * (0.81 - y**2)).square() * ((x.abs() < 0.9) & (y.abs() < 0.9))
    bump = height[:, None] * torch.tensor([0.0, 0.0, 1.0], dtype=F64)
    sheared = mesh.verts + torch.stack([0 * x, 0 * x, 0.5 * x + 0.2 * y], 1)
    alone = regularizers.laplacian(mesh.verts + bump)
    assert float(alone) > 0.01
    assert_close(regularizers.laplacian(sheared + bump) - regularizers.laplacian(sheared), alone)


def rolled(mesh: TriangleMesh, angle: float) -> Tensor:
    """Roll a unit sheet into an arc of this angle, evenly."""
    x, y = mesh.verts[:, 0], mesh.verts[:, 1]
    along = (x + 0.5) * angle
    return torch.stack([torch.sin(along) / angle, y, (1 - torch.cos(along)) / angle], 1)


def folded(mesh: TriangleMesh, angle: float) -> Tensor:
    """Fold a unit sheet along its middle by this angle."""
    x, y = mesh.verts[:, 0], mesh.verts[:, 1]
    beyond = x.clamp_min(0)
    return torch.stack([x - beyond + beyond * math.cos(angle), y, beyond * math.sin(angle)], 1)


@each_case("mesh", [icosphere(3), box(4), torus()])
def test_the_rest_shape_costs_nothing_whatever_creases_it_has(mesh: TriangleMesh) -> None:
    regularizers = Regularizers(mesh)
    assert float(regularizers.normal(mesh.verts)) < 1e-20
    turned = mesh.verts @ torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(1), dtype=F64))[0]
    assert float(regularizers.normal(2.5 * turned + 1.0)) < 1e-12


def test_a_smooth_bend_costs_the_same_at_every_resolution() -> None:
    """A sheet rolled to curvature k: neighbours at distance d across the roll turn by k d, so y = (k d_0)^2 / 2."""
    costs = [float(Regularizers(grid(n)).normal(rolled(grid(n), 2.0))) for n in (20, 40, 80)]
    assert costs[1] == pytest.approx(costs[2], rel=0.03)
    assert costs[0] == pytest.approx(costs[2], rel=0.08)


def test_a_bent_crease_costs_the_same_at_every_resolution() -> None:
    """As an integral of the fourth power, the published form costs eight times as much after one subdivision."""
    costs = [float(Regularizers(grid(n)).normal(folded(grid(n), 1.0))) for n in (50, 100, 200)]
    assert costs[0] == pytest.approx(costs[2], rel=0.2)
    assert costs[1] == pytest.approx(costs[2], rel=0.1)


def test_a_crease_may_open_and_not_sharpen_or_turn_over() -> None:
    mesh = grid(20)
    creased = TriangleMesh(folded(mesh, math.pi / 4), mesh.faces)
    regularizers = Regularizers(creased)
    assert float(regularizers.normal(mesh.verts)) < 1e-20
    assert float(regularizers.normal(folded(mesh, math.pi / 8))) < 1e-20
    sharper, turned = (float(regularizers.normal(folded(mesh, angle))) for angle in (math.pi / 3, -math.pi / 4))
    flat = Regularizers(mesh)
    at_rest = float(flat.normal(folded(mesh, math.pi / 4)))
    assert sharper == pytest.approx(float(flat.normal(folded(mesh, math.pi / 3))) - at_rest, rel=0.1)
    assert turned == pytest.approx(at_rest, rel=0.1)


@each_case("degrees", [10, 60, 170])
def test_at_the_reference_resolution_a_flat_sheet_costs_what_is_published(degrees: float) -> None:
    mesh = grid(50)  # 5,000 faces
    bent = folded(mesh, math.radians(degrees))
    regularizers = Regularizers(mesh)
    regularizers._edge_scale = np.ones_like(regularizers._edge_scale)
    edges = edges_of(mesh.faces)
    normals = face_normals(bent, mesh.faces)[edges.faces[edges.counts == 2]]
    published = (1 - (normals[:, 0] * normals[:, 1]).sum(1)).square().sum() * 2 / 3 / len(mesh.faces)
    assert float(regularizers.normal(bent)) == pytest.approx(float(published), rel=1e-9)


def test_flat_neighbours_cost_nothing_whichever_way_they_are_wound() -> None:
    flat = grid(3)
    some = torch.arange(len(flat.faces)) % 3 == 0
    wound = TriangleMesh(flat.verts, torch.where(some[:, None], flat.faces.flip(1), flat.faces))
    assert float(Regularizers(wound).normal(wound.verts)) < 1e-25
    doubled = TriangleMesh(flat.verts, torch.cat([flat.faces, flat.faces.flip(1)]))
    assert float(Regularizers(doubled).normal(doubled.verts)) < 1e-25


def test_a_crease_costs_more_than_a_curve() -> None:
    """The same quarter turn, once spread over a whole sheet and once at one line."""
    mesh = grid(20)
    x, y = mesh.verts[:, 0], mesh.verts[:, 1]
    angle = (x + 0.5) * math.pi / 2
    curve = torch.stack([torch.sin(angle), y, torch.cos(angle)], 1) * 2 / math.pi
    crease = torch.stack([x.clamp_max(0), y, -x.clamp_min(0)], 1)
    regularizers = Regularizers(mesh)
    assert float(regularizers.normal(crease)) > 10 * float(regularizers.normal(curve)) > 0


@each_case("mesh", [icosphere(0), grid(2), box(1)])
def test_gradients_are_right(mesh: TriangleMesh) -> None:
    generator = torch.Generator().manual_seed(0)
    regularizers = Regularizers(mesh)
    verts = (mesh.verts + 0.1 * torch.randn(mesh.verts.shape, generator=generator, dtype=F64)).requires_grad_()
    jacobians = torch.randn(len(mesh.faces), 3, 3, generator=generator, dtype=F64).requires_grad_()
    assert torch.autograd.gradcheck(regularizers.jacobian, (jacobians,))
    for penalty in (regularizers.laplacian, regularizers.dirichlet):
        assert torch.autograd.gradcheck(penalty, (verts,))
    # At 5,000 reference faces the value of such a coarse mesh is tiny: checked as a multiple.
    assert torch.autograd.gradcheck(lambda v: 1e6 * regularizers.normal(v), (verts,), rtol=1e-4)


def _point(verts: Tensor) -> Tensor:
    return torch.zeros_like(verts)


def _line(verts: Tensor) -> Tensor:
    return verts * torch.tensor([1.0, 0.0, 0.0], dtype=F64)


@each_case("collapse", [_point, _line])
def test_a_mesh_that_collapses_has_finite_gradients(collapse: Callable[[Tensor], Tensor]) -> None:
    mesh = icosphere(1)
    regularizers = Regularizers(mesh)
    verts = collapse(mesh.verts).requires_grad_()
    total = regularizers.laplacian(verts) + regularizers.normal(verts)
    total.backward()
    assert verts.grad is not None
    assert bool(torch.isfinite(total))
    assert float(verts.grad.abs().max()) < 1e6


@each_case(
    "mesh",
    [
        uv_sphere(6, 300),
        TriangleMesh(torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], dtype=F64), torch.tensor([[0, 1, 2]])),
        TriangleMesh(torch.zeros(4, 3, dtype=F64), torch.tensor([[0, 1, 2], [1, 2, 3]])),
        TriangleMesh(torch.zeros(1, 3, dtype=F64), torch.zeros(0, 3, dtype=torch.int64)),
        TriangleMesh(icosphere(1).verts, torch.cat([icosphere(1).faces, torch.tensor([[0, 0, 5], [0, 1, 2]])])),
    ],
)
def test_bad_rest_meshes_give_finite_values_and_gradients(mesh: TriangleMesh) -> None:
    regularizers = Regularizers(mesh)
    verts = (mesh.verts + 0.1 * torch.sin(5 * mesh.verts.flip(1))).requires_grad_()
    jacobians = (1.1 * identity_jacobians(len(mesh.faces))).requires_grad_()
    total = regularizers.laplacian(verts) + regularizers.normal(verts) + regularizers.jacobian(jacobians)
    total.backward()
    assert bool(torch.isfinite(total))
    assert verts.grad is not None
    assert bool(torch.isfinite(verts.grad).all())
