"""What the optimiser moves, Jacobians or an ablation's displacements: at rest first, then where they are pulled."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.deformation.regularizers import Regularizers
from meshdeform.deformation.variables import JacobianField, Variables, copy_into
from meshdeform.errors import CheckpointError
from meshdeform.evaluation.ablations import VertexDisplacements
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join

MESH = icosphere(2)
KINDS = (JacobianField, VertexDisplacements)


@pytest.mark.parametrize("kind", KINDS)
def test_they_begin_at_rest_without_any_strain(kind: Callable[[PoissonSystem], Variables]) -> None:
    variables = kind(PoissonSystem(MESH))
    torch.testing.assert_close(variables.place(), MESH.verts, atol=1e-9, rtol=0)
    assert float(Regularizers(MESH).jacobian(variables.jacobians()).detach()) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_stretch_is_measured_alike(kind: Callable[[PoissonSystem], Variables]) -> None:
    variables = kind(PoissonSystem(MESH))
    stretch = torch.tensor([1.0, 1.5, 1.0], dtype=torch.float64)
    state = {
        "jacobians": torch.diag(stretch).repeat(len(MESH.faces), 1, 1),
        "translations": torch.zeros(1, 3, dtype=torch.float64),
        "displacements": MESH.verts * (stretch - 1),
    }
    copy_into(variables, state)
    torch.testing.assert_close(variables.place(), MESH.verts * stretch, atol=1e-9, rtol=0)
    # Along a normal there is no edge that could say how it is stretched; what there is, is bounded by the whole.
    strain = float(Regularizers(MESH).jacobian(variables.jacobians()).detach())
    assert 0.5 * 0.25 < strain <= 0.25 + 1e-9


def test_a_pull_on_one_vertex_moves_it_alone_or_the_surface_with_it() -> None:
    reach = {}
    for kind in KINDS:
        variables = kind(PoissonSystem(MESH))
        before = variables.place()
        before[0, 1].backward()
        with torch.no_grad():
            for tensor in variables.tensors.values():
                tensor += 0.1 * tensor.grad
        moved = (variables.place().detach() - before.detach()).norm(dim=1)
        reach[kind] = float((moved > 0.05 * moved.max()).double().mean())
    assert reach[VertexDisplacements] < 0.02
    assert reach[JacobianField] > 0.2


def test_a_checkpoint_of_the_other_kind_is_refused() -> None:
    system = PoissonSystem(MESH)
    jacobians, vertices = (kind(system) for kind in KINDS)
    with pytest.raises(CheckpointError, match="displacements"):
        copy_into(vertices, jacobians.tensors)


@pytest.mark.parametrize("kind", KINDS)
def test_any_shape_can_be_adopted_also_of_several_parts(kind: Callable[[PoissonSystem], Variables]) -> None:
    mesh = join(MESH, TriangleMesh(0.5 * MESH.verts + 3.0, MESH.faces))
    variables = kind(PoissonSystem(mesh))
    generator = torch.Generator().manual_seed(0)
    wished = mesh.verts * torch.tensor([1.0, 2.0, 0.7]) + 0.1 * torch.randn(mesh.verts.shape, generator=generator)
    wished[: len(MESH.verts), 0] += 0.5
    variables.adopt(wished)
    found = variables.place().detach()
    shift = (wished - found).mean(0)
    torch.testing.assert_close(found + shift, wished, atol=1e-8, rtol=0)


def test_jacobians_that_have_not_changed_are_solved_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step places its shape for the loss, for its limit and for the guard: one solve serves all three."""
    solved: list[int] = []
    forward = PoissonSystem._forward
    monkeypatch.setattr(PoissonSystem, "_forward", lambda self, field: (solved.append(1), forward(self, field))[1])
    variables = JacobianField(PoissonSystem(icosphere(1)))
    first = variables.place()
    again = variables.place()
    assert torch.equal(first, again)
    assert len(solved) == 1
    again[:, 0].square().sum().backward()
    fresh = JacobianField(PoissonSystem(icosphere(1)))
    fresh.place()[:, 0].square().sum().backward()
    for name, tensor in variables.tensors.items():
        assert tensor.grad is not None
        assert torch.equal(tensor.grad, fresh.tensors[name].grad)  # type: ignore[arg-type]
    solved.clear()
    with torch.no_grad():
        variables.tensors["translations"].add_(1.0)
        variables.place()
        assert not solved, "translations are added to the same solution"
        variables.tensors["jacobians"].mul_(1.1)
    torch.testing.assert_close(variables.place(), 1.1 * first.detach())
    assert len(solved) == 1
