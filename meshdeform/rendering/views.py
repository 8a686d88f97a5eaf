"""Which views a step shows to the guidance, and how: the paper's grid of four orthogonal ones, and what it beats.

==================  =======================================================================
`orthogonal_grid`   four views a quarter turn apart, combined in one picture (the method)
`orthogonal_batch`  the same four views, each a picture of its own with its own noise
`random_batch`      four views from anywhere, each a picture of its own
`random_single`     one view from anywhere
==================  =======================================================================

The last three see each view at the size that the guidance likes a single picture to have (`single_style`).

Coarse to fine: early views can be drawn smaller and enlarged, bilinearly, to the size that the guidance knows. The
share of that size rises linearly and is rounded up to eighths.

Source: Xu et al. 2024, FusionDeformer, sections 3.3 and 4.3.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from meshdeform.guidance.base import Guidance
from meshdeform.rendering.cameras import CameraRange, Cameras, sample_orthogonal_cameras, sample_random_cameras
from meshdeform.rendering.shading import RenderStyle, combine_views
from meshdeform.requests.document import ViewMode

__all__ = ["Views"]

_PARTS = 8


class Views:
    """Draws a step's cameras and lays their pictures out.

    Parameters
    ----------
    mode : ViewMode
    bounds : CameraRange
    guidance : Guidance
        Whose styles the pictures shall have.
    resolution_start : float in (0, 1]
        Share of the views' size that the first steps are drawn in.
    coarse_until : float in (0, 1]
        Share of the run after which that is 1.
    """

    def __init__(
        self,
        mode: ViewMode,
        bounds: CameraRange,
        guidance: Guidance,
        *,
        resolution_start: float = 1.0,
        coarse_until: float = 0.5,
    ) -> None:
        self._mode, self._bounds = mode, bounds
        self._start, self._until = resolution_start, coarse_until
        grid = mode is ViewMode.ORTHOGONAL_GRID
        self.style: RenderStyle = guidance.style if grid else guidance.single_style

    def size(self, fraction: float) -> int:
        """Side in pixels in which a view is drawn at this fraction (0 .. 1) of the run."""
        share = self._start + (1 - self._start) * min(1.0, fraction / self._until)
        return max(1, round(self.style.view_size * math.ceil(_PARTS * share - 1e-9) / _PARTS))

    def sample(self, generator: torch.Generator) -> Cameras:
        """The cameras of one step."""
        if self._mode is ViewMode.RANDOM_BATCH:
            return sample_random_cameras(self._bounds, generator)
        if self._mode is ViewMode.RANDOM_SINGLE:
            return sample_random_cameras(self._bounds, generator, 1)
        return sample_orthogonal_cameras(self._bounds, generator)

    def arrange(self, images: Tensor) -> Tensor:
        """Views (B, h, w, 3) as the guidance takes them, enlarged where they were drawn small.

        Returns
        -------
        (1, 3, 2 S, 2 S) for the grid, else (B, 3, S, S), S the style's `view_size`.
        """
        if images.shape[1] != self.style.view_size:
            side = (self.style.view_size, self.style.view_size)
            small = images.permute(0, 3, 1, 2)
            images = functional.interpolate(small, side, mode="bilinear", align_corners=False).permute(0, 2, 3, 1)
        if self._mode is ViewMode.ORTHOGONAL_GRID:
            return combine_views(images)
        return images.permute(0, 3, 1, 2)
