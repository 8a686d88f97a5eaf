"""Adam with one step size for all: against the formula, and against Adam where both are the same."""

from __future__ import annotations

import torch

from meshdeform.config import Optimizer
from meshdeform.optimizers import AdamUniform, make_optimizer


def test_one_number_moves_as_adam_moves_it() -> None:
    ends = []
    for kind in Optimizer:
        x = torch.tensor([3.0], dtype=torch.float64, requires_grad=True)
        optimizer = make_optimizer(kind, [{"params": [x], "lr": 0.1}])
        for _ in range(50):
            optimizer.zero_grad()
            (x**2).sum().backward()
            optimizer.step()
        ends.append(x.detach().clone())
    torch.testing.assert_close(*ends, atol=1e-6, rtol=0)


def test_where_there_is_little_force_there_is_little_motion() -> None:
    weights = torch.tensor([1.0, 1e-3], dtype=torch.float64)
    moved = {}
    for kind in Optimizer:
        x = torch.zeros(2, dtype=torch.float64, requires_grad=True)
        optimizer = make_optimizer(kind, [{"params": [x], "lr": 0.1}])
        (weights * x).sum().backward()
        optimizer.step()
        moved[kind] = -x.detach()
    torch.testing.assert_close(moved[Optimizer.ADAM], torch.full((2,), 0.1, dtype=torch.float64), atol=1e-5, rtol=0)
    torch.testing.assert_close(moved[Optimizer.ADAM_UNIFORM], 0.1 * weights, atol=1e-8, rtol=0)


def test_its_state_goes_on_where_it_was() -> None:
    x = torch.ones(4, dtype=torch.float64, requires_grad=True)
    whole = AdamUniform([{"params": [x], "lr": 0.05}])
    for _ in range(3):
        x.grad = 2 * x.detach()
        whole.step()
    y = x.detach().clone().requires_grad_()
    resumed = AdamUniform([{"params": [y], "lr": 0.05}])
    resumed.state[y] = {name: value.clone() for name, value in whole.state[x].items()}
    for parameter, optimizer in ((x, whole), (y, resumed)):
        parameter.grad = 2 * parameter.detach()
        optimizer.step()
    assert torch.equal(x, y)
