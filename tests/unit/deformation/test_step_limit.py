"""The symmetric Dirichlet term: known values, gradients, any resolution; and no step that jumps across its wall."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.optimizer import Adam
from meshdeform.deformation.regularizers import Regularizers
from meshdeform.deformation.step_limit import StepLimit
from meshdeform.deformation.variables import JacobianField, Variables, placed
from meshdeform.evaluation.ablations import VertexDisplacements
from meshdeform.geometry.mesh import TriangleMesh, face_areas
from meshdeform.geometry.shapes import grid, icosphere
from meshdeform.guidance.target import TargetGuidance
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.document import DeformParams, resolve
from tests.cases import each_case

F64 = torch.float64

KINDS = (JacobianField, VertexDisplacements)


def scaled(verts: Tensor, *factors: float) -> Tensor:
    return verts * torch.tensor(factors, dtype=F64)


@each_case("n", [2, 9])
def test_a_stretched_sheet_has_the_known_energy_at_every_resolution(n: int) -> None:
    mesh = grid(n)
    regularizers = Regularizers(mesh)
    assert float(regularizers.dirichlet(mesh.verts)) == pytest.approx(0.0, abs=1e-12)
    found = float(regularizers.dirichlet(scaled(mesh.verts, 2.0, 0.5, 1.0)))
    assert found == pytest.approx(4 + 0.25 + 0.25 + 4 - 4)


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
        assert energy == pytest.approx(1 / width**2, rel=0.02)
    flat = scaled(mesh.verts, 1.0, 0.0, 1.0).requires_grad_()
    energy = regularizers.dirichlet(flat)
    energy.backward()
    assert flat.grad is not None
    assert math.isfinite(energy.item())
    assert torch.isfinite(flat.grad).all()


def test_its_gradient_is_right() -> None:
    generator = torch.Generator().manual_seed(0)
    for mesh in (icosphere(0), grid(2)):
        noise = torch.randn(mesh.verts.shape, generator=generator, dtype=F64)
        assert torch.autograd.gradcheck(Regularizers(mesh).dirichlet, ((mesh.verts + 0.1 * noise).requires_grad_(),))


@each_case("kind", KINDS)
def test_what_would_jump_across_is_held_and_the_rest_goes_on(kind: Callable[[TriangleMesh], Variables]) -> None:
    """One vertex of a flat sheet is thrown across its neighbours, in the plane, while the sheet is stretched."""
    mesh = grid(8)
    variables = kind(mesh)
    limit = StepLimit(variables)
    old, before = limit.copy(), placed(variables).detach().clone()
    goal = mesh.verts.clone()
    goal[:, 0] *= 1.1
    inner = int(mesh.verts.square().sum(1).argmin())
    goal[inner, 0] += 0.5
    variables.adopt(goal)
    (tensor,) = variables.tensors.values()
    optimizer = Adam([{"params": [tensor], "lr": 1.0}])
    optimizer.state[tensor]["exp_avg"] = torch.ones_like(tensor)
    assert 0 < limit.enforce(optimizer, old, before) < 1
    after = placed(variables).detach()
    assert (normals(mesh, after)[:, 2] > 0).all()
    right = mesh.verts[:, 0] > 0.45
    assert float((after - mesh.verts)[right, 0].mean()) > 0.02
    forgotten = optimizer.state[tensor]["exp_avg"].flatten(1).norm(dim=1) == 0
    assert 0 < int(forgotten.sum()) < len(tensor)
    assert limit.enforce(optimizer, limit.copy(), after) == 0


def normals(mesh: TriangleMesh, verts: Tensor) -> Tensor:
    corners = verts[mesh.faces]
    crossed: Tensor = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return crossed


def test_a_step_that_turns_all_over_is_not_taken() -> None:
    mesh = grid(3)
    variables = JacobianField(mesh)
    limit = StepLimit(variables)
    old, before = limit.copy(), placed(variables).detach().clone()
    with torch.no_grad():
        variables.tensors["jacobians"][:, 0, 0] = -1.0
    optimizer = Adam([{"params": [variables.tensors["jacobians"]], "lr": 1.0}])
    assert limit.enforce(optimizer, old, before) == 1
    assert (normals(mesh, placed(variables).detach())[:, 2] > 0).all()


def test_a_run_with_the_barrier_keeps_the_faces_that_one_without_it_loses() -> None:
    mesh = icosphere(1, 0.6)
    plate = TriangleMesh(scaled(mesh.verts, 1.4, 0.02, 1.4), mesh.faces)
    guidance = TargetGuidance(plate, style=RenderStyle(view_size=16, supersample=1))
    smallest = []
    for weight in (0.0, 0.1):
        params = resolve(DeformParams.model_validate({
            "guidance": "target", "preset": "paper", "steps": 30, "learning_rate": 0.1, "dirichlet_weight": weight,
            "normal_weight": 0.0, "laplacian_weight": 0.0, "jacobian_reg_weight": 0.0,
        }))  # fmt: skip
        run = Deformation(mesh, guidance, params)
        losses = [step.losses for step in run]
        assert ("dirichlet" in losses[-1]) is bool(weight)
        smallest.append(float((face_areas(run.verts(), mesh.faces) / face_areas(mesh.verts, mesh.faces)).min()))
    assert smallest[1] > 2 * smallest[0]
