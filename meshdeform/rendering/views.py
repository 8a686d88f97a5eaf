"""Which views a step shows to the guidance: four orthogonal ones, combined in one picture.

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
    """Draws a step's cameras and lays their pictures out."""

    style: RenderStyle
    """How each view is drawn."""

    def sample(self, generator: torch.Generator, fitting_radius: float) -> Cameras:
        """Draw the cameras of one step, whose views a sphere of this radius around the origin just fits."""

    def arrange(self, images: Tensor) -> Tensor:
        """Lay views (B, S, S, 3) out as the guidance takes them."""


class OrthogonalGrid:
    """Four views a quarter turn apart in one picture.

    Parameters
    ----------
    bounds : CameraRange
    style : RenderStyle
        Of each view.
    """

    def __init__(self, bounds: CameraRange, style: RenderStyle) -> None:
        self._bounds = bounds
        self.style = style

    def sample(self, generator: torch.Generator, fitting_radius: float) -> Cameras:
        """Draw the cameras of one step."""
        return sample_orthogonal_cameras(self._bounds, generator, fitting_radius)

    def arrange(self, images: Tensor) -> Tensor:
        """Combine views (4, S, S, 3) in one picture (1, 3, 2 S, 2 S)."""
        return combine_views(images)
