"""Choose the views of a step: four orthogonal ones, combined into one picture for the guidance.

Source: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from meshdeform.rendering.cameras import CameraRange, Cameras, sample_orthogonal_cameras
from meshdeform.rendering.shading import RenderStyle, combine_views

__all__ = ["OrthogonalGrid", "Views"]


class Views(Protocol):
    """Cameras of a step and the layout of their pictures."""

    style: RenderStyle
    """Style of each view."""

    def sample(self, generator: torch.Generator, fitting_radius: float, turn_deg: float = 0.0) -> Cameras:
        """Draw the cameras of one step.

        Parameters
        ----------
        generator : torch.Generator on the CPU
        fitting_radius : float
            Radius of the sphere around the origin that just fits the views.
        turn_deg : float
            Azimuth of the shape's front, as in `cameras.fixed_cameras`.
        """

    def arrange(self, images: Tensor) -> Tensor:
        """Arrange views (B, S, S, 3) as input of the guidance."""


class OrthogonalGrid:
    """Four views a quarter turn apart in one picture.

    Parameters
    ----------
    bounds : CameraRange
    style : RenderStyle
        Style of each view.
    """

    def __init__(self, bounds: CameraRange, style: RenderStyle) -> None:
        self._bounds = bounds
        self.style = style

    def sample(self, generator: torch.Generator, fitting_radius: float, turn_deg: float = 0.0) -> Cameras:
        """Draw the cameras of one step."""
        return sample_orthogonal_cameras(self._bounds, generator, fitting_radius, turn_deg)

    def arrange(self, images: Tensor) -> Tensor:
        """Combine views (4, S, S, 3) into one picture (1, 3, 2 S, 2 S)."""
        return combine_views(images)
