"""Adam against torch's own."""

from __future__ import annotations

import torch

from meshdeform.deformation.variables import Adam
from tests.cases import each_case


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


def test_what_has_no_gradient_stays() -> None:
    x = torch.ones(3, requires_grad=True)
    optimizer = Adam([{"params": [x], "lr": 0.1}])
    optimizer.step()
    assert torch.equal(x, torch.ones(3))
    assert optimizer.state == {}


def test_its_state_goes_on_where_it_was() -> None:
    x = torch.ones(4, dtype=torch.float64, requires_grad=True)
    whole = Adam([{"params": [x], "lr": 0.05}])
    for _ in range(3):
        x.grad = 2 * x.detach()
        whole.step()
    y = x.detach().clone().requires_grad_()
    resumed = Adam([{"params": [y], "lr": 0.05}])
    resumed.state[y] = {name: value.clone() for name, value in whole.state[x].items()}
    for parameter, optimizer in ((x, whole), (y, resumed)):
        parameter.grad = 2 * parameter.detach()
        optimizer.step()
    assert torch.equal(x, y)
