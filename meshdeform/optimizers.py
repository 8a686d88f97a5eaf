"""Adam whose steps have one size for all faces.

Adam divides every entry's gradient by that entry's own spread, so a face that no view pulls moves as fast as one that
all views pull, along whatever noise it gets. Here the spread is the largest of the tensor, as Nicolet et al. use it
for vertices: where there is little force there is little motion.

::

    m <- b1 m + (1 - b1) g        v <- b2 v + (1 - b2) g^2        x <- x - lr m_hat / (sqrt(max v_hat) + 1e-8)

Source: Nicolet et al. 2021, Large steps in inverse rendering of geometry, section 3.4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, overload

import torch
from torch import Tensor

from meshdeform.config import Optimizer

__all__ = ["AdamUniform", "make_optimizer"]

_BETAS = (0.9, 0.999)
_EPSILON = 1e-8


class AdamUniform(torch.optim.Optimizer):
    """Adam with one second moment a tensor.

    Parameters
    ----------
    groups : iterable of parameter groups
        Each with its `lr`.
    betas : (float, float)
    """

    def __init__(self, groups: Iterable[dict[str, Any]], betas: tuple[float, float] = _BETAS) -> None:
        super().__init__(groups, {"lr": 1e-3, "betas": betas})

    @overload
    def step(self, closure: None = None) -> None: ...

    @overload
    def step(self, closure: Callable[[], float]) -> float: ...

    @torch.no_grad()
    def step(self, closure: Callable[[], float] | None = None) -> float | None:
        """Move every parameter that has a gradient."""
        loss = closure() if closure is not None else None
        for group in self.param_groups:
            first, second = group["betas"]
            for parameter in group["params"]:
                if parameter.grad is None:
                    continue
                self._move(parameter, parameter.grad, group["lr"], first, second)
        return loss

    def _move(self, parameter: Tensor, gradient: Tensor, rate: float, first: float, second: float) -> None:
        state = self.state[parameter]
        if not state:
            state["step"] = torch.tensor(0.0)
            state["exp_avg"] = torch.zeros_like(parameter)
            state["exp_avg_sq"] = torch.zeros_like(parameter)
        state["step"] += 1
        done = float(state["step"])
        state["exp_avg"].lerp_(gradient, 1 - first)
        state["exp_avg_sq"].lerp_(gradient.square(), 1 - second)
        spread = (state["exp_avg_sq"].max() / (1 - second**done)).sqrt() + _EPSILON
        parameter.sub_(rate / (1 - first**done) * state["exp_avg"] / spread)


def make_optimizer(kind: Optimizer, groups: list[dict[str, Any]]) -> torch.optim.Optimizer:
    """The optimiser of a run, over groups of one tensor each with its `lr`."""
    if kind is Optimizer.ADAM_UNIFORM:
        return AdamUniform(groups)
    return torch.optim.Adam(groups, betas=_BETAS)
