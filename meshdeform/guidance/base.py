"""The interface between the optimisation and what pulls the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import torch
from torch import Tensor

if TYPE_CHECKING:
    from meshdeform.rendering.cameras import Cameras
    from meshdeform.rendering.shading import RenderStyle

__all__ = ["Guidance", "StepContext"]


@dataclass(frozen=True)
class StepContext:
    """What a guidance knows about the step besides the image.

    Attributes
    ----------
    step : int
        Steps done before this one, from 0.
    total_steps : int
        Length of the whole run; a resumed run has the same.
    cameras : Cameras
        The four cameras that drew the image, or one for each picture.
    generator : torch.Generator on the CPU
        The job's only source of randomness. Draw on the CPU and move the result, so that a seed means the same on
        every device.
    """

    step: int
    total_steps: int
    cameras: Cameras
    generator: torch.Generator

    @property
    def fraction(self) -> float:
        """How far the run is: 0 at the first step, 1 at the last."""
        return self.step / max(self.total_steps - 1, 1)


class Guidance(Protocol):
    """Pulls the rendered views."""

    @property
    def style(self) -> RenderStyle:
        """How views must look."""

    @property
    def identity(self) -> dict[str, str]:
        """`id`, `revision` and `sha256`, for the report."""

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Say how far the views are from what they should be.

        Parameters
        ----------
        image : (1, 3, S, S) or (B, 3, S, S) float32 in [0, 1]
            The four views in one picture (`shading.combine_views`), or a picture of its own for each camera.
        context : StepContext

        Returns
        -------
        A scalar whose gradient with respect to `image` pulls the mesh, and named numbers for the log.

        Raises
        ------
        NumericalError
            It is not finite.
        """
