"""Choose the cameras of each step, and arrange their pictures as a prior takes them.

Image models know single pictures, so four views a quarter turn apart share one (`OrthogonalGrid`, the paper's). A
multi-view model knows its own cameras, and asks for them by the `rig` of its style; it gets a picture from each
(`RigViews`). Those cameras stand still: neither azimuths nor elevation are drawn, because the model saw no others.

Source of the grid: Xu et al. 2024, FusionDeformer, section 4.2 and eq. 8.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from meshdeform.rendering.cameras import (
    CameraRange,
    CameraRig,
    Cameras,
    fixed_cameras,
    rig_cameras,
    sample_orthogonal_cameras,
)
from meshdeform.rendering.shading import RenderStyle, combine_views

__all__ = ["OrthogonalGrid", "RigViews", "Views", "views_for"]


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

    def place(self, azimuth_deg: float, fitting_radius: float) -> Cameras:
        """Place cameras whose view 0 is at an azimuth, without drawing anything, to grade orientations."""

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

    def place(self, azimuth_deg: float, fitting_radius: float) -> Cameras:
        """Place the cameras at the middle elevation and with the middle field of view."""
        bounds = self._bounds
        elevation = (bounds.elevation_min_deg + bounds.elevation_max_deg) / 2
        fov = (bounds.fov_min_deg + bounds.fov_max_deg) / 2
        return fixed_cameras(azimuth_deg, elevation, fov, fitting_radius=fitting_radius)

    def arrange(self, images: Tensor) -> Tensor:
        """Combine views (4, S, S, 3) into one picture (1, 3, 2 S, 2 S)."""
        return combine_views(images)


class RigViews:
    """The views of a prior's own cameras, the same in every step, in a picture each.

    Parameters
    ----------
    rig : CameraRig
    style : RenderStyle
        Style of each view.
    """

    def __init__(self, rig: CameraRig, style: RenderStyle) -> None:
        self._rig = rig
        self.style = style

    def sample(self, _generator: torch.Generator, fitting_radius: float, turn_deg: float = 0.0) -> Cameras:
        """Return the cameras; nothing is drawn."""
        return rig_cameras(self._rig, fitting_radius, turn_deg=turn_deg)

    def place(self, azimuth_deg: float, fitting_radius: float) -> Cameras:
        """Place the cameras so that view 0 is at an azimuth."""
        return rig_cameras(self._rig, fitting_radius, azimuth_deg=azimuth_deg)

    def arrange(self, images: Tensor) -> Tensor:
        """Return views (B, S, S, 3) as pictures (B, 3, S, S)."""
        return images.permute(0, 3, 1, 2)


def views_for(bounds: CameraRange, style: RenderStyle) -> Views:
    """Return the views of a style: those of its own cameras, or by default the paper's grid within `bounds`."""
    return OrthogonalGrid(bounds, style) if style.rig is None else RigViews(style.rig, style)
