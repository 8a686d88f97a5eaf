"""When is a run over? When the shape no longer goes anywhere, though noise still shakes it.

Adam moves every variable by about its rate at every step, however little there is left to gain, and score distillation
draws new noise each time: neither the length of a step nor the loss says that nothing happens any more. What the steps
have in common does. With x the vertices and d the diagonal of the rest mesh's box::

    u <- beta u + (1 - beta) (x_k - x_(k-1))        speed_k = sqrt(mean |u|^2 / (1 - beta^k)^2) / d

Shaking averages out of u, going somewhere does not. The run has settled when the speed is below a share of the highest
that it ever had. A share, for rates, presets and priors have paces of their own.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

__all__ = ["Settling"]

_BETA = 0.95
_LEAST_STEPS = 25
_PREFIX = "settling."


class Settling:
    """Follows the vertices of one run.

    Parameters
    ----------
    share : float in (0, 1)
        Of the highest speed.
    diagonal : float
        Of the rest mesh's box, in the unit of the vertices.
    """

    def __init__(self, share: float, diagonal: float) -> None:
        self._share, self._diagonal = share, max(diagonal, 1e-300)
        self._last: Tensor | None = None
        self._velocity = torch.zeros(())
        self._peak, self._count = 0.0, 0

    @property
    def speed(self) -> float:
        """Smoothed root mean square displacement a step, over the diagonal; 0 before the second shape."""
        if not self._count:
            return 0.0
        corrected = self._velocity / (1 - _BETA**self._count)
        return float(corrected.square().sum(-1).mean().sqrt()) / self._diagonal

    @property
    def settled(self) -> bool:
        """Whether the speed is below the share of its peak."""
        return self._count >= _LEAST_STEPS and self.speed <= self._share * self._peak

    def add(self, verts: Tensor) -> None:
        """Take the next shape (V, 3) float64."""
        verts = verts.detach().clone()
        if self._last is not None:
            self._velocity = _BETA * self._velocity + (1 - _BETA) * (verts - self._last)
            self._count += 1
            # The first few are nearly single steps, and as long as those.
            if self._count >= _LEAST_STEPS:
                self._peak = max(self._peak, self.speed)
        self._last = verts

    @property
    def state(self) -> dict[str, Tensor]:
        """For checkpoints; empty before the first shape."""
        if self._last is None:
            return {}
        numbers = torch.tensor([self._peak, float(self._count)], dtype=torch.float64)
        velocity = self._velocity.expand_as(self._last).clone()
        return {f"{_PREFIX}last": self._last, f"{_PREFIX}velocity": velocity, f"{_PREFIX}numbers": numbers}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Go on from what `state` gave."""
        last = state.get(f"{_PREFIX}last")
        self._last = last
        self._velocity, self._peak, self._count = torch.zeros(()), 0.0, 0
        if last is not None:
            self._velocity = state[f"{_PREFIX}velocity"]
            peak, count = state[f"{_PREFIX}numbers"].tolist()
            self._peak, self._count = peak, int(count)
