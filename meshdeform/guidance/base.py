"""What the optimisation asks of a guidance: a scalar whose gradient on the rendered views says where to go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import torch
from torch import Tensor

if TYPE_CHECKING:
    from meshdeform.cameras import Cameras
    from meshdeform.shading import RenderStyle

__all__ = ["Guidance", "StepContext"]


@dataclass(frozen=True)
class StepContext:
    """What a guidance may know about the step.

    Attributes
    ----------
    step : int
        Steps done before this one.
    total_steps : int
    cameras : Cameras
        The four cameras of the image.
    generator : torch.Generator on the CPU
        The only source of randomness: draw on the CPU, then move to the device, so that every device sees the
        same numbers and a resumed run continues the sequence.
    """

    step: int
    total_steps: int
    cameras: Cameras
    generator: torch.Generator

    @property
    def progress(self) -> float:
        """0 at the first step, 1 at the last."""
        return self.step / max(self.total_steps - 1, 1)


class Guidance(Protocol):
    """Something that pulls the mesh by its picture."""

    style: RenderStyle
    """How the views must be drawn."""

    identity: dict[str, str]
    """What it is, for the report: kind, model id, revision, hash."""

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Judge the combined picture of the four views.

        Parameters
        ----------
        image : (1, 3, S, S) float32 in [0, 1], differentiable
        context : StepContext

        Returns
        -------
        A scalar to minimise, and figures for the log.

        Raises
        ------
        NumericalError
            The result is not finite.
        """
