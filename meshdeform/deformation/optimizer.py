"""Update tensors with Adam.

::

    m <- b1 m + (1 - b1) g        v <- b2 v + (1 - b2) g^2        x <- x - lr m_hat / (sqrt(v_hat) + 1e-8)

torch's own optimiser is not used, because creating one loads torch's compiler and its dependencies, which takes longer
than a whole short run and as much memory as the prior. The results are bit-identical; a test compares them.

Source: Kingma & Ba 2015, Adam, algorithm 1.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor

__all__ = ["Adam"]

_EPSILON = 1e-8


class Adam:
    """Adam over groups of tensors, each group with its own learning rate.

    Parameters
    ----------
    groups : iterable of dict
        Each with `params`, a list of tensors that require gradients, and `lr`, which may change between steps.
    betas : (float, float)
        b1 and b2.

    Attributes
    ----------
    param_groups : list of dict
        The groups.
    state : dict of Tensor to dict
        State of each tensor after its first step: `step` () float32, the number of its steps; `exp_avg` m and
        `exp_avg_sq` v, with the tensor's shape and dtype.
    """

    def __init__(self, groups: Iterable[dict[str, Any]], betas: tuple[float, float] = (0.9, 0.999)) -> None:
        self.param_groups = [dict(group) for group in groups]
        self.state: defaultdict[Tensor, dict[str, Tensor]] = defaultdict(dict)
        self._betas = betas

    def zero_grad(self) -> None:
        """Clear the gradients."""
        for group in self.param_groups:
            for parameter in group["params"]:
                parameter.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Update every tensor that has a gradient."""
        first, second = self._betas
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is None:
                    continue
                state = self._state(parameter)
                state["step"] += 1
                done = float(state["step"])
                state["exp_avg"].lerp_(parameter.grad, 1 - first)
                state["exp_avg_sq"].mul_(second).addcmul_(parameter.grad, parameter.grad, value=1 - second)
                root = (1 - second**done) ** 0.5
                spread = (state["exp_avg_sq"].sqrt() / root).add_(_EPSILON)
                parameter.addcdiv_(state["exp_avg"], spread, value=-group["lr"] / (1 - first**done))

    def _state(self, parameter: Tensor) -> dict[str, Tensor]:
        state = self.state[parameter]
        if not state:
            state["step"] = torch.tensor(0.0)
            state["exp_avg"] = torch.zeros_like(parameter)
            state["exp_avg_sq"] = torch.zeros_like(parameter)
        return state
