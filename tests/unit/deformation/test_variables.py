"""What the optimiser moves, Jacobians or a test's displacements: at rest first, then where they are pulled."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from meshdeform.deformation.poisson import PoissonSystem
from meshdeform.deformation.variables import Adam, JacobianField, Variables, copy_into, placed
from meshdeform.errors import CheckpointError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.tensors import verts_of
from tests.cases import each_case
from tests.close import assert_close
from tests.displacements import VertexDisplacements

MESH = icosphere(2)
KINDS = (JacobianField, VertexDisplacements)


@each_case("kind", KINDS)
def test_a_stretch_is_measured_alike(kind: Callable[[TriangleMesh], Variables]) -> None:
    variables = kind(MESH)
    stretch = torch.tensor([1.0, 1.5, 1.0], dtype=torch.float64)
    state = {
        "jacobians": torch.diag(stretch).repeat(len(MESH.faces), 1, 1),
        "displacements": verts_of(MESH) * (stretch - 1),
    }
    copy_into(variables, state)
    with pytest.raises(CheckpointError):
        copy_into(variables, {"others": verts_of(MESH)})
    assert_close(placed(variables), verts_of(MESH) * stretch, atol=1e-9, rtol=0)
    # Along a normal there is no edge that could say how it is stretched; what there is, is bounded by the whole.
    strain = float(variables.jacobian_penalty().detach())
    assert 0.5 * 0.25 < strain <= 0.25 + 1e-9


@each_case("kind", KINDS)
def test_any_shape_of_one_part_can_be_adopted(kind: Callable[[TriangleMesh], Variables]) -> None:
    variables = kind(MESH)
    generator = torch.Generator().manual_seed(0)
    wished = verts_of(MESH) * torch.tensor([1.0, 2.0, 0.7]) + 0.1 * torch.randn(
        verts_of(MESH).shape, generator=generator
    )
    variables.adopt(wished)
    found = placed(variables).detach()
    shift = (wished - found).mean(0)
    assert_close(found + shift, wished, atol=1e-8, rtol=0)


def test_jacobians_that_have_not_changed_are_solved_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step places its shape for the loss, for its limit and for the guard: one solve serves all three."""
    solved: list[int] = []
    solve = PoissonSystem.solve
    monkeypatch.setattr(PoissonSystem, "solve", lambda self, field: (solved.append(1), solve(self, field))[1])
    variables = JacobianField(icosphere(1))
    first = placed(variables)
    again = placed(variables)
    assert torch.equal(first, again)
    assert len(solved) == 1
    again[:, 0].square().sum().backward()
    fresh = JacobianField(icosphere(1))
    placed(fresh)[:, 0].square().sum().backward()
    for name, tensor in variables.tensors.items():
        assert tensor.grad is not None
        assert torch.equal(tensor.grad, fresh.tensors[name].grad)  # type: ignore[arg-type]
    solved.clear()
    with torch.no_grad():
        variables.tensors["jacobians"].mul_(1.1)
    assert_close(placed(variables), 1.1 * first.detach())
    assert len(solved) == 1


# Adam against torch's own.


@each_case("dtype", [torch.float32, torch.float64])
def test_every_step_is_that_of_torch_to_the_last_bit(dtype: torch.dtype) -> None:
    generator = torch.Generator().manual_seed(0)
    start = [
        torch.randn(40, 3, 3, generator=generator, dtype=dtype),
        torch.randn(2, 3, generator=generator, dtype=dtype),
    ]
    ours, theirs = ([tensor.clone().requires_grad_() for tensor in start] for _ in range(2))
    rates = (0.03, 1.7)
    pair = [
        kind([{"params": [tensor], "lr": rate} for tensor, rate in zip(tensors, rates, strict=True)])
        for kind, tensors in ((Adam, ours), (torch.optim.Adam, theirs))
    ]
    for number in range(200):
        for tensors in (ours, theirs):
            for tensor in tensors:
                tensor.grad = (tensor.detach() ** 3 - 0.2 * number).clone()
        if number == 100:
            for optimizer in pair:
                optimizer.param_groups[0]["lr"] = 0.002
        for optimizer in pair:
            optimizer.step()
    for mine, its in zip(ours, theirs, strict=True):
        assert torch.equal(mine, its)
        assert torch.equal(pair[0].state[mine]["exp_avg_sq"], pair[1].state[its]["exp_avg_sq"])
