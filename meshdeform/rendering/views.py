"""Choose the cameras of each step, and arrange their pictures as a prior takes them.

Image models know single pictures, so four views a quarter turn apart share one.

Source: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8.
"""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.rendering.cameras import CameraRange, Cameras, fixed_cameras, sample_orthogonal_cameras
from meshdeform.rendering.shading import RenderStyle, combine_views

__all__ = ["OrthogonalGrid"]


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
        """Draw the cameras of one step.

        Parameters
        ----------
        generator : torch.Generator on the CPU
        fitting_radius : float
            Radius of the sphere around the origin that just fits the views.
        turn_deg : float
            Azimuth of the shape's front, as in `cameras.fixed_cameras`.
        """
        return sample_orthogonal_cameras(self._bounds, generator, fitting_radius, turn_deg)

    def place(self, azimuth_deg: float, fitting_radius: float) -> Cameras:
        """Place cameras whose view 0 is at an azimuth, without drawing anything, to grade orientations."""
        bounds = self._bounds
        elevation = (bounds.elevation_min_deg + bounds.elevation_max_deg) / 2
        fov = (bounds.fov_min_deg + bounds.fov_max_deg) / 2
        return fixed_cameras(azimuth_deg, elevation, fov, fitting_radius=fitting_radius)

    def arrange(self, images: Tensor) -> Tensor:
        """Combine views (4, S, S, 3) into one picture (1, 3, 2 S, 2 S)."""
        return combine_views(images)
