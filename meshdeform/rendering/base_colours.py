"""Look up the base colours of a surface at its pixels: factor, texture, vertex colour, cut-outs and transparency.

Colours are differentiable in the interpolated attributes, and through them in the positions. A cut-out has no gradient
if each pixel is either kept or removed, so `coverage` gives a pixel at the edge of a cut-out the share that is kept::

    coverage = clamp((alpha - cutoff) / w + 1/2, 0, 1)         w = |grad alpha| in alpha per pixel, constant

which is the area left of a straight edge through the pixel; its gradient moves that edge.

Source of the coverage: Golus 2017, Anti-aliased Alpha Test.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from meshdeform.assets.appearance import Appearance
from meshdeform.rendering.textures import Textures

__all__ = ["MAX_LAYERS", "BaseColours"]

MAX_LAYERS = 8
"""Surfaces behind each other that are drawn where those in front are transparent."""

_OPAQUE, _MASK, _BLEND = 0, 1, 2
_MODES = {"OPAQUE": _OPAQUE, "MASK": _MASK}
_STEEP = 1e-3
"""Change of alpha per pixel below which a cut-out has no edge nearby."""


class BaseColours:
    """Base colours of an asset's surface.

    Parameters
    ----------
    appearance : Appearance
    device : str or torch.device

    Attributes
    ----------
    rows : (M,) int64
        Vertex of the drawn mesh of each vertex of the appearance.
    faces : (F, 3) int64
        With the numbers of `rows`.
    paint : (F,) int64
    values : (M, 6) float32
        Texture coordinates and vertex colours, to interpolate.
    layers : int
        Surfaces behind each other that have to be drawn at most.
    """

    def __init__(self, appearance: Appearance, device: torch.device | str = "cpu") -> None:
        paints = appearance.paints
        self.rows = torch.from_numpy(appearance.rows).to(device)
        self.faces = torch.from_numpy(appearance.triangles).to(device)
        self.paint = torch.from_numpy(appearance.paint_of_triangle).to(device)
        self.values = torch.from_numpy(np.concatenate([appearance.texcoords, appearance.colors], 1)).to(device)
        self._textures = Textures([paint.texture for paint in paints], device)
        self._textured = torch.tensor([paint.texture is not None for paint in paints], device=device)
        self._factor = torch.tensor([paint.factor for paint in paints], dtype=torch.float32, device=device)
        modes = [_MODES.get(paint.alpha_mode, _BLEND) for paint in paints]
        self._mode = torch.tensor(modes, device=device)
        self._cutoff = torch.tensor([paint.alpha_cutoff for paint in paints], device=device)
        self.layers = MAX_LAYERS if any(modes) else 1

    def levels(self, clip: Tensor, faces: Tensor, paint: Tensor, side: int) -> Tensor:
        """Return the binary logarithm of the size of a pixel in texels.

        Parameters
        ----------
        clip : (B, M, 4) floating
        faces : (F, 3) int64
        paint : (F,) int64
        side : int
            Side of a view in pixels.

        Returns
        -------
        (B, F)
        """
        place = clip[..., :2] / clip[..., 3:].clamp_min(1e-6) * (side / 2)
        return 0.5 * ((self._texels(faces, paint) + 1e-12) / (_double_area(place[:, faces]) + 1e-6)).log2()

    def strides(self, clip: Tensor, side: int) -> Tensor | None:
        """Return the change of texel coordinates per pixel across and along, (B, F, 2, 2); None without cut-outs."""
        if not bool((self._mode == _MASK).any()):
            return None
        place = clip[..., :2] / clip[..., 3:].clamp_min(1e-6) * (side / 2)
        texels = self.values[self.faces][..., :2] * self._textures.sizes[self.paint].flip(-1)[:, None]
        (a, b), (s, t) = (
            (c[..., 1, :] - c[..., 0, :], c[..., 2, :] - c[..., 0, :]) for c in (place[:, self.faces], texels)
        )
        double_area = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        divisor = torch.where(double_area.abs() > 1e-6, double_area, 1e-6)[..., None]
        right = (s * b[..., 1:] - t * a[..., 1:]) / divisor
        down = (t * a[..., :1] - s * b[..., :1]) / divisor
        return torch.stack([right, down], -2)

    def texel_areas(self) -> Tensor:
        """Return the areas (F,) of the faces in texels."""
        return self._texels(self.faces, self.paint) / 2

    def _texels(self, faces: Tensor, paint: Tensor) -> Tensor:
        return _double_area(self.values[faces][..., :2] * self._textures.sizes[paint].flip(-1)[:, None])

    def colours(self, paint: Tensor, values: Tensor, level: Tensor) -> Tensor:
        """Return linear RGB and alpha (P, 4) for interpolated values (P, 6); alpha as the file has it."""
        colour = self._factor[paint] * values[:, 2:]
        textured = self._textured[paint].nonzero()[:, 0]
        if len(textured):
            texel = self._textures.sample(paint[textured], values[textured, :2], level[textured])
            colour = colour.index_copy(0, textured, colour[textured] * texel)
        return colour

    def opacity(self, paint: Tensor, colour: Tensor) -> Tensor:
        """Return the share (P,) of the surface that hides what is behind; 0 or 1 in cut-outs."""
        alpha, mode = colour[:, 3], self._mode[paint]
        alpha = torch.where(mode == _MASK, (alpha >= self._cutoff[paint]).to(alpha), alpha.clamp(0, 1))
        return torch.where(mode == _OPAQUE, 1.0, alpha)

    def coverage(self, paint: Tensor, values: Tensor, level: Tensor, colour: Tensor, stride: Tensor | None) -> Tensor:
        """Return `opacity` (P,), but at the edge of a cut-out the share that is left; `stride` is (P, 2, 2)."""
        found = self.opacity(paint, colour)
        cut = ((self._mode[paint] == _MASK) & self._textured[paint]).nonzero()[:, 0]
        if not len(cut) or stride is None:
            return found
        paint, alpha = paint[cut], colour[cut, 3]
        cutoff = self._cutoff[paint]
        with torch.no_grad():
            slope = self._textures.alpha_slope(paint, values[cut, :2], level[cut])
            change = (stride[cut] @ slope[:, :, None])[..., 0].norm(dim=-1)
            # Not wider than what keeps alpha 0 removed and alpha 1 whole.
            most = 2 * torch.minimum(cutoff, 1 - cutoff)
            width = torch.minimum(change * self._factor[paint, 3] * values[cut, 5], most)
            edge = width > _STEEP
        covered = ((alpha - cutoff) / torch.where(edge, width, 1.0) + 0.5).clamp(0, 1)
        return found.index_copy(0, cut, torch.where(edge, covered, found[cut]))


def _double_area(corners: Tensor) -> Tensor:
    """Return twice the area of triangles (..., 3, 2)."""
    a, b = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    return (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).abs()
