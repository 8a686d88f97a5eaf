"""Attachments: zero where nothing moves apart, known where something does, cheap where there is nothing to hold."""

from __future__ import annotations

import pytest
import torch

from meshdeform.deformation.attachments import Attachments
from meshdeform.geometry.mesh import TriangleMesh, connected_components
from meshdeform.geometry.shapes import box, icosphere, join


def of(mesh: TriangleMesh) -> Attachments:
    return Attachments(mesh, connected_components(mesh.faces, mesh.verts.shape[0]))


def moved(mesh: TriangleMesh, offset: float) -> TriangleMesh:
    return TriangleMesh(mesh.verts + torch.tensor([offset, 0.0, 0.0], dtype=torch.float64), mesh.faces)


TOUCHING = join(icosphere(2, 0.5), moved(icosphere(2, 0.5), 1.0))


def test_one_component_has_nothing_to_hold() -> None:
    attachments = of(icosphere(3))
    assert len(attachments) == 0
    assert attachments.penalty(icosphere(3).verts * 2).item() == 0


def test_parts_that_are_far_apart_are_free() -> None:
    assert len(of(join(icosphere(1, 0.1), moved(icosphere(1, 0.1), 5.0)))) == 0


def test_moving_together_costs_nothing_and_moving_apart_what_the_formula_says() -> None:
    attachments = of(TOUCHING)
    assert len(attachments) > 0
    shift = torch.tensor([3.0, -1.0, 2.0], dtype=torch.float64)
    assert attachments.penalty(TOUCHING.verts + shift).item() == pytest.approx(0, abs=1e-20)
    apart = TOUCHING.verts.clone()
    apart[icosphere(2).verts.shape[0] :, 0] += 0.3
    area = 2 * 4 * torch.pi * 0.5**2
    assert attachments.penalty(apart).item() == pytest.approx(0.09 / area, rel=0.05)


def test_the_scale_does_not_matter() -> None:
    bent = TOUCHING.verts + 0.1 * TOUCHING.verts**2
    large = TriangleMesh(TOUCHING.verts * 40, TOUCHING.faces)
    assert of(large).penalty(bent * 40).item() == pytest.approx(of(TOUCHING).penalty(bent).item())


def test_gradcheck() -> None:
    mesh = join(box(1), moved(box(1), 1.0))
    attachments = of(mesh)
    assert torch.autograd.gradcheck(attachments.penalty, (mesh.verts * 1.1).requires_grad_())


def test_hundreds_of_parts_are_held_and_many_thousands_are_let_go() -> None:
    tetrahedron = TriangleMesh(
        torch.eye(4, 3, dtype=torch.float64) * 0.9, torch.tensor([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    )
    assert len(of(join(*[moved(tetrahedron, float(k)) for k in range(300)]))) > 299
    many = 1_500
    verts = torch.cat([moved(tetrahedron, float(k)).verts for k in range(many)])
    faces = (tetrahedron.faces[None] + 4 * torch.arange(many)[:, None, None]).reshape(-1, 3)
    assert len(of(TriangleMesh(verts, faces))) == 0
