"""Which views a step shows to the guidance, and how: the paper's grid of four orthogonal ones, and what it beats.

==================  =======================================================================
`orthogonal_grid`   four views a quarter turn apart, combined in one picture (the method)
`orthogonal_batch`  the same four views, each a picture of its own with its own noise
`random_batch`      four views from anywhere, each a picture of its own
`random_single`     one view from anywhere
==================  =======================================================================

The last three see each view at the size that the guidance likes a single picture to have (`single_style`).

Source: Xu et al. 2024, FusionDeformer, sections 3.3 and 4.3.
"""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.cameras import CameraRange, Cameras, sample_orthogonal_cameras, sample_random_cameras
from meshdeform.config import ViewMode
from meshdeform.guidance.base import Guidance
from meshdeform.shading import RenderStyle, combine_views

__all__ = ["Views"]


class Views:
    """Draws a step's cameras and lays their pictures out.

    Parameters
    ----------
    mode : ViewMode
    bounds : CameraRange
    guidance : Guidance
        Whose styles the pictures shall have.
    """

    def __init__(self, mode: ViewMode, bounds: CameraRange, guidance: Guidance) -> None:
        self._mode, self._bounds = mode, bounds
        grid = mode is ViewMode.ORTHOGONAL_GRID
        self.style: RenderStyle = guidance.style if grid else guidance.single_style

    def sample(self, generator: torch.Generator) -> Cameras:
        """The cameras of one step."""
        if self._mode is ViewMode.RANDOM_BATCH:
            return sample_random_cameras(self._bounds, generator)
        if self._mode is ViewMode.RANDOM_SINGLE:
            return sample_random_cameras(self._bounds, generator, 1)
        return sample_orthogonal_cameras(self._bounds, generator)

    def arrange(self, images: Tensor) -> Tensor:
        """Views (B, H, W, 3) as the guidance takes them: (1, 3, 2H, 2W) for the grid, else (B, 3, H, W)."""
        if self._mode is ViewMode.ORTHOGONAL_GRID:
            return combine_views(images)
        return images.permute(0, 3, 1, 2)
