"""Measure how hard each regulariser pulls against the guidance.

A term's pull is the norm of its gradient with respect to the variables. That of the guidance differs tenfold from one
step to the next, with the noise; so both are summed over the measured steps before they are compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

__all__ = ["TERMS", "Pulls"]

TERMS = ("guidance", "jacobian", "laplacian", "normal", "dirichlet")
_EVERY_STEPS, _FIRST = 20, 10
"""A measurement takes a third of a step. At step 0 the regularisers of most runs are zero."""


class Pulls:
    """Sums of the pulls of the terms of a loss.

    Attributes
    ----------
    sums : (5,) float64
        In the order of `TERMS`, over the measured steps.
    """

    def __init__(self) -> None:
        self.sums = torch.zeros(len(TERMS), dtype=torch.float64)

    def measure(self, terms: Mapping[str, Tensor], variables: Sequence[Tensor], step: int) -> None:
        """Add the pulls of the terms, if this step is one of those to measure.

        Parameters
        ----------
        terms : mapping of name to () float64
            Some of `TERMS`, weighted; their graphs are kept.
        variables : sequence of Tensor
        step : int
            Number of completed steps.
        """
        if step % _EVERY_STEPS != _FIRST:
            return
        for row, name in enumerate(TERMS):
            if name in terms and terms[name].requires_grad:
                gradients = torch.autograd.grad(terms[name], variables, retain_graph=True, allow_unused=True)
                squares = sum(float(gradient.square().sum()) for gradient in gradients if gradient is not None)
                self.sums[row] += squares**0.5

    def to_dict(self) -> dict[str, float] | None:
        """Return each regulariser's pull as a multiple of the guidance's; None before the first measurement."""
        guidance, *regularizers = self.sums.tolist()
        if guidance == 0:
            return None
        return {name: pull / guidance for name, pull in zip(TERMS[1:], regularizers, strict=True)}

    @property
    def warnings(self) -> list[str]:
        """A sentence for each regulariser that pulls harder than the guidance: it decides the shape."""
        return [
            f"The regulariser `{name}` pulled {pull:.1f} times as hard as the guidance: lower its weight to change the "
            "asset further."
            for name, pull in (self.to_dict() or {}).items()
            if pull > 1
        ]
