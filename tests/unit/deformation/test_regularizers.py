"""The penalties mean the same at every resolution and scale, and their gradients survive bad faces."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.deformation.differentiable import identity_jacobians
from meshdeform.deformation.jacobians import completed_jacobians
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.regularizers import STRAINED, Pulls, Regularizers
from meshdeform.geometry.mesh import TriangleMesh, edges_of
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.tensors import face_normals, faces_of, verts_of
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.runs.goals import score_distillation
from tests.cases import each_case
from tests.close import assert_close
from tests.meshes import mesh_of
from tests.unit.deformation.worlds import params
from training.shapes import box, cylinder, grid, torus, uv_sphere

F64 = torch.float64


def smooth(verts: Tensor) -> Tensor:
    """A smooth map of space: stretched, bent and twisted a little."""
    x, y, z = (verts * torch.tensor([1.0, 1.3, 0.8], dtype=F64)).unbind(1)
    return torch.stack([x + 0.2 * torch.sin(1.5 * y), y + 0.1 * x * z, z - 0.15 * torch.cos(2 * x)], 1)


def penalties(mesh: TriangleMesh, verts: Tensor) -> dict[str, float]:
    regularizers = Regularizers(mesh)
    jacobians = torch.from_numpy(completed_jacobians(mesh, verts.numpy()))
    return {
        "jacobian": float(regularizers.jacobian(jacobians)),
        "laplacian": float(regularizers.laplacian(verts)),
        "normal": float(regularizers.normal(verts)),
    }


def test_resolution_and_scale_do_not_matter() -> None:
    sphere = icosphere(2)
    for unit in (1e-3, 50.0):
        scaled = mesh_of(verts_of(sphere) * unit, faces_of(sphere))
        found = penalties(scaled, smooth(verts_of(sphere)) * unit)
        assert found == pytest.approx(penalties(sphere, smooth(verts_of(sphere))), rel=1e-9)
    values = [penalties(mesh, smooth(verts_of(mesh))) for mesh in (icosphere(3), icosphere(4), icosphere(5))]
    for name in values[0]:
        assert values[0][name] == pytest.approx(values[2][name], rel=0.06), name
        assert values[1][name] == pytest.approx(values[2][name], rel=0.02), name


@each_case("mesh", [join(box(3), icosphere(2), grid(3)), torus()])
def test_the_rest_shape_costs_nothing_whatever_detail_and_creases_it_has(mesh: TriangleMesh) -> None:
    assert max(penalties(mesh, verts_of(mesh)).values()) < 1e-20
    turned = (
        verts_of(mesh) @ torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(1), dtype=F64))[0]
    )
    assert float(Regularizers(mesh).normal(2.5 * turned + 1.0)) < 1e-12


def test_the_jacobian_term_of_a_constant_and_the_laplacian_term_of_a_sphere_that_grows_are_known() -> None:
    """For u = c x on the unit sphere Delta u = -2 c x, so the integral of its square over 4 pi is 4 c^2."""
    mesh = icosphere(4)
    stretched = torch.diag(torch.tensor([2.0, 1.0, 0.5], dtype=F64)).expand(len(mesh.faces), 3, 3)
    assert float(Regularizers(mesh).jacobian(stretched)) == pytest.approx(1.25)
    assert float(Regularizers(mesh).laplacian(1.3 * verts_of(mesh))) == pytest.approx(4 * 0.09, rel=0.01)


def test_the_laplacian_term_does_not_see_a_shear_inside_a_plane() -> None:
    """A linear displacement bends nothing inside: beside it a bump costs what it costs alone."""
    mesh = grid(40, 2.0)
    regularizers = Regularizers(mesh)
    x, y = verts_of(mesh)[:, 0], verts_of(mesh)[:, 1]
    height = ((0.81 - x**2) * (0.81 - y**2)).square() * ((x.abs() < 0.9) & (y.abs() < 0.9))
    bump = height[:, None] * torch.tensor([0.0, 0.0, 1.0], dtype=F64)
    sheared = verts_of(mesh) + torch.stack([0 * x, 0 * x, 0.5 * x + 0.2 * y], 1)
    alone = regularizers.laplacian(verts_of(mesh) + bump)
    assert float(alone) > 0.01
    assert_close(regularizers.laplacian(sheared + bump) - regularizers.laplacian(sheared), alone)


def rolled(mesh: TriangleMesh, angle: float) -> Tensor:
    """Roll a unit sheet into an arc of this angle, evenly."""
    x, y = verts_of(mesh)[:, 0], verts_of(mesh)[:, 1]
    along = (x + 0.5) * angle
    return torch.stack([torch.sin(along) / angle, y, (1 - torch.cos(along)) / angle], 1)


def folded(mesh: TriangleMesh, angle: float) -> Tensor:
    """Fold a unit sheet along its middle by this angle."""
    x, y = verts_of(mesh)[:, 0], verts_of(mesh)[:, 1]
    beyond = x.clamp_min(0)
    return torch.stack([x - beyond + beyond * math.cos(angle), y, beyond * math.sin(angle)], 1)


@each_case("bend, angle, sizes, apart", [(rolled, 2.0, (20, 40, 80), 0.08), (folded, 1.0, (50, 100, 200), 0.2)])
def test_a_bend_costs_the_same_at_every_resolution(
    bend: Callable[[TriangleMesh, float], Tensor], angle: float, sizes: tuple[int, ...], apart: float
) -> None:
    """Smooth or a crease, where the published form, an integral of the fourth power, grows with each subdivision."""
    costs = [float(Regularizers(grid(n)).normal(bend(grid(n), angle))) for n in sizes]
    assert costs[0] == pytest.approx(costs[2], rel=apart)
    assert costs[1] == pytest.approx(costs[2], rel=apart / 2)


def test_a_crease_may_open_and_not_sharpen_or_turn_over() -> None:
    mesh = grid(20)
    creased = mesh_of(folded(mesh, math.pi / 4), faces_of(mesh))
    regularizers = Regularizers(creased)
    assert float(regularizers.normal(verts_of(mesh))) < 1e-20
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
    normals = face_normals(bent, faces_of(mesh))[edges.faces[edges.counts == 2]]
    published = (1 - (normals[:, 0] * normals[:, 1]).sum(1)).square().sum() * 2 / 3 / len(mesh.faces)
    assert float(regularizers.normal(bent)) == pytest.approx(float(published), rel=1e-9)


def test_flat_neighbours_cost_nothing_whichever_way_they_are_wound() -> None:
    flat = grid(3)
    some = torch.arange(len(flat.faces)) % 3 == 0
    wound = mesh_of(verts_of(flat), torch.where(some[:, None], faces_of(flat).flip(1), faces_of(flat)))
    assert float(Regularizers(wound).normal(verts_of(wound))) < 1e-25
    doubled = mesh_of(verts_of(flat), torch.cat([faces_of(flat), faces_of(flat).flip(1)]))
    assert float(Regularizers(doubled).normal(verts_of(doubled))) < 1e-25


@each_case("mesh", [icosphere(0), grid(2), box(1)])
def test_gradients_are_right(mesh: TriangleMesh) -> None:
    generator = torch.Generator().manual_seed(0)
    regularizers = Regularizers(mesh)
    verts = (verts_of(mesh) + 0.1 * torch.randn(verts_of(mesh).shape, generator=generator, dtype=F64)).requires_grad_()
    jacobians = torch.randn(len(mesh.faces), 3, 3, generator=generator, dtype=F64).requires_grad_()
    assert torch.autograd.gradcheck(regularizers.jacobian, (jacobians,))
    for penalty in (regularizers.laplacian, regularizers.dirichlet):
        assert torch.autograd.gradcheck(penalty, (verts,))
    # At 5,000 reference faces the value of such a coarse mesh is tiny: checked as a multiple.
    assert torch.autograd.gradcheck(lambda v: 1e6 * regularizers.normal(v), (verts,), rtol=1e-4)


def shaken(mesh: TriangleMesh) -> tuple[TriangleMesh, Tensor]:
    return mesh, verts_of(mesh) + 0.1 * torch.sin(5 * verts_of(mesh).flip(1))


SPHERE = icosphere(1)


@each_case(
    "mesh, verts",
    [
        (SPHERE, torch.zeros_like(verts_of(SPHERE))),
        (SPHERE, verts_of(SPHERE) * torch.tensor([1.0, 0.0, 0.0], dtype=F64)),
        shaken(uv_sphere(6, 300)),
        shaken(mesh_of(torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], dtype=F64), torch.tensor([[0, 1, 2]]))),
        shaken(mesh_of(torch.zeros(4, 3, dtype=F64), torch.tensor([[0, 1, 2], [1, 2, 3]]))),
        shaken(mesh_of(torch.zeros(1, 3, dtype=F64), torch.zeros(0, 3, dtype=torch.int64))),
        shaken(mesh_of(verts_of(SPHERE), torch.cat([faces_of(SPHERE), torch.tensor([[0, 0, 5], [0, 1, 2]])]))),
    ],
    ids=["a point", "a line", "needles", "a collapsed face", "no area", "no face", "faces that fold"],
)
def test_what_collapses_or_is_collapsed_at_rest_has_finite_values_and_gradients(
    mesh: TriangleMesh, verts: Tensor
) -> None:
    regularizers = Regularizers(mesh)
    verts = verts.clone().requires_grad_()
    jacobians = (1.1 * identity_jacobians(len(mesh.faces))).requires_grad_()
    total = regularizers.laplacian(verts) + regularizers.normal(verts) + regularizers.jacobian(jacobians)
    total.backward()
    assert bool(torch.isfinite(total))
    assert verts.grad is not None
    assert float(verts.grad.abs().max()) < 1e6


# The symmetric Dirichlet term: known values, gradients, any resolution; and no face that outweighs the others.


def test_the_dirichlet_term_is_known_in_every_unit_free_for_motions_and_finite_at_a_collapse() -> None:
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0), dtype=F64))[0]
    for n, unit in ((2, 1.0), (9, 1e-6)):
        mesh = mesh_of(unit * verts_of(grid(n)), faces_of(grid(n)))
        energy = Regularizers(mesh).dirichlet
        assert float(energy(verts_of(mesh) @ turn + 5 * unit)) == pytest.approx(0.0, abs=1e-9)
        found = float(energy(verts_of(mesh) * torch.tensor([2.0, 0.5, 1.0])))
        assert found == pytest.approx(logarithm(4 + 0.25 + 0.25 + 4 - 4))
        for width in (1e-1, 1e-2, 1e-3):
            thin = float(energy(verts_of(mesh) * torch.tensor([1.0, width, 1.0])))
            assert thin == pytest.approx(logarithm(1 / width**2), rel=0.02)
        flat = (verts_of(mesh) * torch.tensor([1.0, 0.0, 1.0])).requires_grad_()
        energy(flat).backward()
        assert math.isfinite(energy(flat).item())
        assert flat.grad is not None
        assert torch.isfinite(flat.grad).all()


def logarithm(energy: float) -> float:
    """The strain that counts: near a collapse the plain energy of one face would outweigh all others."""
    return STRAINED * math.log1p(energy / STRAINED)


# The pulls of regularisers are norms of gradients against the guidance's, and on needles stay below it.


def test_a_pull_is_the_norm_of_the_gradient_summed_over_the_measured_steps() -> None:
    first, second = (torch.zeros(n, dtype=torch.float64, requires_grad=True) for n in (4, 3))
    unused = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    pulls = Pulls()
    assert pulls.to_dict() is None
    for step in range(60):
        slope = 3.0 if step == 10 else 9.0  # measured at 10, 30 and 50
        terms = {"guidance": slope * first.sum(), "normal": first.sum() + 2 * second[0]}
        pulls.measure(terms, [first, second, unused], step)
    ratios = pulls.to_dict()
    assert ratios is not None
    assert ratios["normal"] == pytest.approx(3 * math.sqrt(8) / (6 + 18 + 18))
    assert ratios["laplacian"] == 0
    assert first.grad is None


@each_case("steps, given, decides", [(60, {}, ""), (31, {"jacobian_reg_weight": 3000}, "jacobian")])
def test_on_needles_no_regulariser_outweighs_the_guidance_unnamed(
    steps: int, given: dict[str, float], decides: str
) -> None:
    settings = params(guidance="sds", steps=steps, **given)
    needles = cylinder(0.25, 1.0, 96, 1)
    deformation = Deformation(needles, score_distillation(BuiltinPrior(), "a bus", settings), settings)
    for _ in deformation:
        pass
    pulls = deformation.pulls.to_dict()
    assert pulls is not None
    assert {name for name, pull in pulls.items() if pull > 0} >= {"normal", "dirichlet"}
    assert {name for name, pull in pulls.items() if pull >= 1} == ({decides} if decides else set())
    assert [decides in warning for warning in deformation.pulls.warnings] == [True] * bool(decides)
