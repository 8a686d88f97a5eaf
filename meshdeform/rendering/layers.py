"""Compose surfaces behind each other, for pictures with holes and glass."""

from __future__ import annotations

import torch
from torch import Tensor

from meshdeform.rendering.base_colours import OPAQUE_ENOUGH
from meshdeform.rendering.rasterizer import Fragments
from meshdeform.rendering.visibility import EMPTY_DEPTH

_INFINITE = 9.0
_SEEN = 0.5
"""Opacity from which a surface, and not what is behind it, has silhouettes."""


class Layers:
    """Surfaces behind each other in B views of `side` pixels, composed from front to back in linear light.

    `like`: of the dtype and device of the picture; `behind`, (B, side, side) float32 or None: depth up to which
    triangles belong to earlier layers, for `rasterize`; `depth` and `removed`, (B, side, side) float32: for
    `antialias`: depth of the surface that is seen, and of the farthest one in front of it that is cut out.
    """

    def __init__(self, views: int, side: int, like: Tensor) -> None:
        self._shape = (views, side, side)
        self._light = like.new_zeros(views * side * side, 3)
        self._through = like.new_ones(views * side * side, 1)
        self.behind: Tensor | None = None
        self.depth = torch.full(self._shape, EMPTY_DEPTH, dtype=torch.float32, device=like.device)
        self.removed = torch.full_like(self.depth, -torch.inf)
        self._hidden = torch.zeros_like(self.depth, dtype=torch.bool)

    def add(self, fragments: Fragments, pixels: Tensor, light: Tensor, alpha: Tensor) -> bool:
        """Add the next layer behind the others; return whether what is behind it shows.

        Parameters
        ----------
        fragments : Fragments
            Found with `behind`.
        pixels : (P,) int64
            The covered pixels.
        light : (P, 3)
        alpha : (P, 1)
        """
        before = self._through[pixels]
        share = before * alpha
        self._light = self._light.index_add(0, pixels, share * light)
        self._through = self._through.index_copy(0, pixels, before - share)
        with torch.no_grad():
            # Where an earlier layer is seen, this one is too, if at all, behind it.
            left = self._through.view(self._shape)
            new = (fragments.face_ids >= 0) & ~self._hidden
            seen = new & (left < _SEEN)
            self.depth = torch.where(seen, fragments.depth, self.depth)
            self.removed = torch.where(new & ~seen, fragments.depth, self.removed)
            self._hidden |= seen
            open_ = (left > 1 - OPAQUE_ENOUGH) & (fragments.face_ids >= 0)
            self.behind = torch.where(open_, fragments.depth, _INFINITE)
            return bool(open_.any())

    def over(self, background: Tensor) -> Tensor:
        """Return the picture (B, side, side, 3) in front of a linear background (B * side * side, 3), or (1, 3)."""
        return (self._light + self._through * background).view(*self._shape, 3)
