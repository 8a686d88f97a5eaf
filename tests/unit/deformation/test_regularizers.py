"""The penalties mean the same at every resolution and scale, and their gradients survive bad faces."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.poisson import completed_jacobians, identity_jacobians
from meshdeform.deformation.regularizers import STRAINED, Pulls, Regularizers
from meshdeform.geometry.mesh import TriangleMesh, edges_of, face_areas, face_normals
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.guidance.target import TargetGuidance
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.goals import score_distillation
from tests.cases import each_case
from tests.close import assert_close
from training.evaluation.summary import outweighed
from training.shapes import box, grid, torus, uv_sphere

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


# The symmetric Dirichlet term: known values, gradients, any resolution; and no face that outweighs the others.


def logarithm(energy: float) -> float:
    return STRAINED * math.log1p(energy / STRAINED)


def scaled(verts: Tensor, *factors: float) -> Tensor:
    return verts * torch.tensor(factors, dtype=F64)


@each_case("n", [2, 9])
def test_a_stretched_sheet_has_the_known_energy_at_every_resolution(n: int) -> None:
    mesh = grid(n)
    regularizers = Regularizers(mesh)
    assert float(regularizers.dirichlet(mesh.verts)) == pytest.approx(0.0, abs=1e-12)
    found = float(regularizers.dirichlet(scaled(mesh.verts, 2.0, 0.5, 1.0)))
    assert found == pytest.approx(logarithm(4 + 0.25 + 0.25 + 4 - 4))


def test_a_motion_costs_nothing_and_the_unit_does_not_matter() -> None:
    mesh = icosphere(2)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0), dtype=F64))[0]
    assert float(Regularizers(mesh).dirichlet(mesh.verts @ turn + 5)) == pytest.approx(0.0, abs=1e-9)
    small = TriangleMesh(mesh.verts * 1e-6, mesh.faces)
    one = Regularizers(mesh).dirichlet(scaled(mesh.verts, 1.0, 3.0, 1.0))
    other = Regularizers(small).dirichlet(scaled(small.verts, 1.0, 3.0, 1.0))
    assert float(one) == pytest.approx(float(other))


def test_it_grows_without_bound_towards_a_collapse_and_stays_finite_at_it() -> None:
    mesh = grid(3)
    regularizers = Regularizers(mesh)
    for width in (1e-1, 1e-2, 1e-3):
        energy = float(regularizers.dirichlet(scaled(mesh.verts, 1.0, width, 1.0)))
        assert energy == pytest.approx(logarithm(1 / width**2), rel=0.02)
    flat = scaled(mesh.verts, 1.0, 0.0, 1.0).requires_grad_()
    energy = regularizers.dirichlet(flat)
    energy.backward()
    assert flat.grad is not None
    assert math.isfinite(energy.item())
    assert torch.isfinite(flat.grad).all()


def test_a_face_that_nearly_collapses_outweighs_no_others() -> None:
    """In the plain energy it would be a hundred million, for all steps left."""
    mesh = grid(20)
    verts = mesh.verts.clone()
    first, second = verts[mesh.faces[100, 0]], verts[mesh.faces[100, 1]]
    verts[mesh.faces[100, 0]] = second + 1e-4 * (first - second)
    assert float(Regularizers(mesh).dirichlet(verts)) < 10


def test_a_run_with_the_barrier_keeps_the_faces_that_one_without_it_loses() -> None:
    mesh = icosphere(1, 0.6)
    plate = TriangleMesh(scaled(mesh.verts, 1.4, 0.02, 1.4), mesh.faces)
    guidance = TargetGuidance(plate, style=RenderStyle(view_size=16, supersample=1))
    smallest = []
    for weight in (0.0, 0.1):
        params = resolve(
            DeformParams.model_validate(
                {
                    "preset": "paper",
                    "steps": 30,
                    "learning_rate": 0.1,
                    "dirichlet_weight": weight,
                    "normal_weight": 0.0,
                    "laplacian_weight": 0.0,
                    "jacobian_reg_weight": 0.0,
                    "guidance": {"kind": "target"},
                }
            )
        )
        run = Deformation(mesh, guidance, params)
        losses = [step.losses for step in run]
        assert ("dirichlet" in losses[-1]) is bool(weight)
        smallest.append(float((face_areas(run.verts(), mesh.faces) / face_areas(mesh.verts, mesh.faces)).min()))
    assert smallest[1] > 2 * smallest[0]


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


def cylinder(radius: float, sides: int = 96) -> TriangleMesh:
    """A closed cylinder of needles, whose sides are some thirty times as long as wide."""
    angle = torch.arange(sides, dtype=torch.float64) * (2 * math.pi / sides)
    ring = torch.stack([radius * angle.cos(), torch.full_like(angle, 0.5), radius * angle.sin()], 1)
    axis = torch.tensor([[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]], dtype=torch.float64)
    verts = torch.cat([ring, ring * torch.tensor([1.0, -1.0, 1.0]), axis])
    here = torch.arange(sides)
    there = (here + 1) % sides
    top, bottom = torch.full_like(here, 2 * sides), torch.full_like(here, 2 * sides + 1)
    corners = [(here, there, here + sides), (there, there + sides, here + sides), (here, top, there)]
    corners.append((here + sides, there + sides, bottom))
    faces = torch.cat([torch.stack(each, 1) for each in corners])
    return TriangleMesh(verts, faces.flip(1))


def needles() -> TriangleMesh:
    """Two cylinders beside each other: a multi-part asset."""
    part = cylinder(0.25)
    shift = torch.tensor([0.3, 0.0, 0.0], dtype=torch.float64)
    return join(TriangleMesh(part.verts - shift, part.faces), TriangleMesh(part.verts + shift, part.faces))


@each_case("mesh", [cylinder(0.25), needles()])
def test_on_needles_no_regulariser_outweighs_the_guidance(mesh: TriangleMesh) -> None:
    settings = resolve(DeformParams.model_validate({"preset": "preview", "steps": 60}))
    deformation = Deformation(mesh, score_distillation(BuiltinPrior(), "a bus", settings), settings)
    for _ in deformation:
        pass
    pulls = deformation.pulls.to_dict()
    assert pulls is not None
    assert {name for name, pull in pulls.items() if pull > 0} >= {"normal", "dirichlet"}
    assert max(pulls.values()) < 1, pulls
    assert not deformation.pulls.warnings


def test_a_regulariser_that_decides_is_named() -> None:
    settings = resolve(DeformParams.model_validate({"preset": "preview", "steps": 31, "jacobian_reg_weight": 3000}))
    deformation = Deformation(cylinder(0.25), score_distillation(BuiltinPrior(), "a bus", settings), settings)
    for _ in deformation:
        pass
    (warning,) = deformation.pulls.warnings
    assert "jacobian" in warning
    record = {"source": "cylinder", "prompt": "a bus", "seed": 0, "pulls": deformation.pulls.to_dict()}
    (line,) = outweighed([record, {**record, "pulls": None}])
    assert line.startswith("cylinder, a bus, seed 0: `jacobian`")
