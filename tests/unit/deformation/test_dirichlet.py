"""The symmetric Dirichlet term: known values, gradients, any resolution; and no face that outweighs the others."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.regularizers import STRAINED, Regularizers
from meshdeform.geometry.mesh import TriangleMesh, face_areas
from meshdeform.geometry.shapes import grid, icosphere
from meshdeform.guidance.target import TargetGuidance
from meshdeform.rendering.shading import RenderStyle
from meshdeform.requests.document import DeformParams, resolve
from tests.cases import each_case

F64 = torch.float64


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


def test_its_gradient_is_right() -> None:
    generator = torch.Generator().manual_seed(0)
    for mesh in (icosphere(0), grid(2)):
        noise = torch.randn(mesh.verts.shape, generator=generator, dtype=F64)
        assert torch.autograd.gradcheck(Regularizers(mesh).dirichlet, ((mesh.verts + 0.1 * noise).requires_grad_(),))


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
