"""Look up the base colours of a surface at its pixels: factor, texture, vertex colour, cut-outs and transparency.

Colours are differentiable in the interpolated attributes, and through them in the positions. A cut-out has no gradient
if each pixel is either kept or removed, so `coverage` gives a pixel at the edge of a cut-out the share that is kept::

    coverage = clamp((alpha - cutoff) / w + 1/2, 0, 1)         w = |grad alpha| in alpha per pixel, constant

which is the area left of a straight edge through the pixel; its gradient moves that edge. Transparent surfaces behind
each other are composed from front to back, in linear light.

All textures of an asset are in one array, with their halved copies, filtered bilinearly. A face uses the copy whose
texels are about as large as its pixels, so that fine patterns do not flicker. Wrap modes are those of the sampler.
Colours are decoded from sRGB before they are mixed.

Sources: Golus 2017, Anti-aliased Alpha Test (the coverage); Williams 1983, Pyramidal Parametrics (the halved copies);
glTF 2.0 specification, section 3.8.4 (samplers).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.geometry.appearance import Appearance, Texture
from meshdeform.rendering.rasterizer import EMPTY_DEPTH, Fragments

_WRAPS = {"repeat": 0, "clamp": 1, "mirror": 2}
_LEVELS = 11
_WHITE = Texture(np.full((1, 1, 4), 255, np.uint8))


class Textures:
    """The textures of an asset's paints.

    Parameters
    ----------
    textures : sequence of Texture or None
        One per paint; None is white.
    """

    def __init__(self, textures: Sequence[Texture | None], device: torch.device | str = "cpu") -> None:
        starts, sizes, chunks, at = [], [], [], 0
        shared: dict[int, tuple[list[int], list[tuple[int, int]]]] = {}
        for texture in (texture_or_white or _WHITE for texture_or_white in textures):
            if id(texture.pixels) not in shared:
                levels = _halved(texture.pixels) if texture.reduced else [texture.pixels]
                place = [at + sum(level.shape[0] * level.shape[1] for level in levels[:k]) for k in range(len(levels))]
                shared[id(texture.pixels)] = place, [level.shape[:2] for level in levels]
                chunks += [level.reshape(-1, 4) for level in levels]
                at += sum(level.shape[0] * level.shape[1] for level in levels)
            place, size = shared[id(texture.pixels)]
            starts.append([place[min(k, len(place) - 1)] for k in range(_LEVELS)])
            sizes.append([size[min(k, len(size) - 1)] for k in range(_LEVELS)])
        wraps = [[_WRAPS[mode] for mode in (texture_or_white or _WHITE).wrap] for texture_or_white in textures]
        self._texels = torch.from_numpy(np.concatenate(chunks)).to(device)
        self._starts = torch.tensor(starts, device=device)
        self._sizes = torch.tensor(sizes, device=device)
        self._wraps = torch.tensor(wraps, device=device)
        self._nearest = torch.tensor(
            [texture_or_white is not None and texture_or_white.nearest for texture_or_white in textures], device=device
        )
        self._linear = linear_from_srgb(torch.arange(256, device=device) / 255)

    @property
    def sizes(self) -> Tensor:
        """Height and width (N, 2) of each paint's texture."""
        return self._sizes[:, 0]

    def sample(self, paint: Tensor, texcoords: Tensor, level: Tensor) -> Tensor:
        """Look up colours.

        Parameters
        ----------
        paint : (P,) int64
        texcoords : (P, 2) floating
            v downwards.
        level : (P,) floating
            Binary logarithm of the size of a pixel in texels, rounded down to a copy that exists.

        Returns
        -------
        (P, 4) float32: linear RGB and alpha, differentiable in `texcoords`.
        """
        corners, share, _ = self._around(paint, texcoords, level)
        upper, lower = (torch.lerp(left, right, share[:, :1]) for left, right in corners)
        return torch.lerp(upper, lower, share[:, 1:])

    def alpha_slope(self, paint: Tensor, texcoords: Tensor, level: Tensor) -> Tensor:
        """Return the gradient of alpha (P, 2) per texel of the picture itself; parameters as in `sample`."""
        corners, share, copy = self._around(paint, texcoords, level)
        (a, b), (c, d) = ([corner[:, 3] for corner in row] for row in corners)
        slope = torch.stack([torch.lerp(b - a, d - c, share[:, 1]), torch.lerp(c - a, d - b, share[:, 0])], 1)
        return slope * self._sizes[paint, copy].flip(-1) / self.sizes[paint].flip(-1)

    def _around(self, paint: Tensor, texcoords: Tensor, level: Tensor) -> tuple[list[list[Tensor]], Tensor, Tensor]:
        """Return the colours of the four texels around, in rows, the shares (P, 2) of the latter ones, and the copy."""
        copy = level.detach().floor().clamp(0, _LEVELS - 1).long()
        size, start = self._sizes[paint, copy], self._starts[paint, copy]
        square = self._nearest[paint] & (level < 0)
        place = texcoords * size.flip(-1) - 0.5
        place = torch.where(square[:, None], place.round(), place)
        low = place.detach().floor()
        share = place - low
        width, wraps = size[:, 1], self._wraps[paint]
        rows = [_wrapped(low[:, 1].long() + step, size[:, 0], wraps[:, 1]) * width + start for step in (0, 1)]
        columns = [_wrapped(low[:, 0].long() + step, width, wraps[:, 0]) for step in (0, 1)]
        corners = [[self._colours(row + column).to(share.dtype) for column in columns] for row in rows]
        return corners, share, copy

    def _colours(self, index: Tensor) -> Tensor:
        texels = self._texels[index].long()
        return torch.cat([self._linear[texels[:, :3]], texels[:, 3:] / 255], 1)


def _wrapped(index: Tensor, count: Tensor, mode: Tensor) -> Tensor:
    """Apply each wrap mode to a texel's index."""
    twice = index.remainder(2 * count)
    mirrored = torch.minimum(twice, 2 * count - 1 - twice)
    clamped = torch.minimum(index.clamp_min(0), count - 1)
    return torch.where(mode == 0, index.remainder(count), torch.where(mode == 1, clamped, mirrored))


def _halved(pixels: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the picture and its halved copies, down to 4 pixels."""
    levels = [pixels]
    while len(levels) < _LEVELS and min(levels[-1].shape[:2]) >= 8:
        last = levels[-1]
        height, width = last.shape[0] // 2, last.shape[1] // 2
        squares = last[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 4)
        levels.append((squares.mean((1, 3), dtype=np.float32) + 0.5).astype(np.uint8))
    return levels


def linear_from_srgb(values: Tensor) -> Tensor:
    """Decode sRGB in [0, 1]."""
    return torch.where(values <= 0.04045, values / 12.92, ((values.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(values: Tensor) -> Tensor:
    """Encode linear light in [0, 1] as sRGB."""
    return torch.where(values <= 0.0031308, values * 12.92, 1.055 * values.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


_OPAQUE_ENOUGH = 0.98
_INFINITE = 9.0
_SEEN = 0.5
"""Opacity from which a surface, and not what is behind it, has silhouettes."""


class Layers:
    """Layers of B views of `side` pixels.

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
            open_ = (left > 1 - _OPAQUE_ENOUGH) & (fragments.face_ids >= 0)
            self.behind = torch.where(open_, fragments.depth, _INFINITE)
            return bool(open_.any())

    def over(self, background: Tensor) -> Tensor:
        """Return the picture (B, side, side, 3) in front of a linear background (B * side * side, 3), or (1, 3)."""
        return (self._light + self._through * background).view(*self._shape, 3)


MAX_LAYERS = 8
"""Surfaces behind each other that are drawn where those in front are transparent."""

_OPAQUE, _MASK, _BLEND = 0, 1, 2
_MODES = {"OPAQUE": _OPAQUE, "MASK": _MASK}
_STEEP = 1e-3
"""Change of alpha per pixel below which a cut-out has no edge nearby."""


class BaseColours:
    """Base colours of an asset's surface.

    `rows`, (M,) int64: vertex of the drawn mesh of each vertex of the appearance; `faces`, (F, 3) int64: with the
    numbers of `rows`; `paint` is (F,) int64; `values`, (M, 6) float32: texture coordinates and vertex colours, to
    interpolate; `layers`: surfaces behind each other that have to be drawn at most.
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
        opacity = self.opacity(paint, colour)
        cut = ((self._mode[paint] == _MASK) & self._textured[paint]).nonzero()[:, 0]
        if not len(cut) or stride is None:
            return opacity
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
        return opacity.index_copy(0, cut, torch.where(edge, covered, opacity[cut]))


def _double_area(corners: Tensor) -> Tensor:
    """Return twice the area of triangles (..., 3, 2)."""
    a, b = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    return (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).abs()
