"""Look up the base colours of a surface at its pixels: factor, texture, vertex colour, cut-outs and transparency.

Arrays are numpy's for pictures, and torch's tensors where a picture is differentiated: a look is given the library at
the start and computes with it. Colours are differentiable in the interpolated attributes, and through them in the
positions. A cut-out has no gradient if each pixel is either kept or removed, so `coverage` gives a pixel at the edge of
a cut-out the share that is kept::

    coverage = clamp((alpha - cutoff) / w + 1/2, 0, 1)         w = |grad alpha| in alpha per pixel, constant

which is the area left of a straight edge through the pixel; its gradient moves that edge.

All textures of an asset are in one array, with their halved copies, filtered bilinearly. A face uses the copy whose
texels are about as large as its pixels, so that fine patterns do not flicker. Wrap modes are those of the sampler.
Colours are decoded from sRGB before they are mixed.

Sources: Golus 2017, Anti-aliased Alpha Test (the coverage); Williams 1983, Pyramidal Parametrics (the halved copies);
glTF 2.0 specification, section 3.8.4 (samplers).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.appearance import Appearance, Texture
from meshdeform.geometry.srgb import linear_from_srgb

Array = Any
"""A numpy array or a torch tensor."""

_WRAPS = {"repeat": 0, "clamp": 1, "mirror": 2}
_LEVELS = 11
_WHITE = Texture(np.full((1, 1, 4), 255, np.uint8))
MAX_LAYERS = 8
"""Surfaces behind each other that are drawn where those in front are transparent."""
OPAQUE_ENOUGH = 0.98
"""Opacity from which a pixel shows nothing of what is behind it."""
_OPAQUE, _MASK, _BLEND = 0, 1, 2
_MODES = {"OPAQUE": _OPAQUE, "MASK": _MASK}
_STEEP = 1e-3
"""Change of alpha per pixel below which a cut-out has no edge nearby."""


class Textures:
    """The textures of an asset's paints.

    Parameters
    ----------
    textures : sequence of Texture or None
        One per paint; None is white.
    library : module
        numpy or torch.
    as_array : callable
        Makes an array of the library from one of numpy.

    Attributes
    ----------
    extents : (2, N) float32
        Width and height of each paint's texture.
    """

    def __init__(
        self, textures: Sequence[Texture | None], library: Any = np, as_array: Callable[[Any], Array] = np.asarray
    ) -> None:
        starts, sizes, chunks, at = [], [], [], 0
        shared: dict[int, tuple[list[int], list[tuple[int, int]]]] = {}
        some = [texture or _WHITE for texture in textures]
        for texture in some:
            if id(texture.pixels) not in shared:
                levels = _halved(texture.pixels) if texture.reduced else [texture.pixels]
                begins = [at + sum(level.shape[0] * level.shape[1] for level in levels[:k]) for k in range(len(levels))]
                shared[id(texture.pixels)] = begins, [level.shape[1::-1] for level in levels]
                chunks += [level.reshape(-1, 4) for level in levels]
                at += sum(level.shape[0] * level.shape[1] for level in levels)
            begins, size = shared[id(texture.pixels)]
            starts.append([begins[min(k, len(begins) - 1)] for k in range(_LEVELS)])
            sizes.append([size[min(k, len(size) - 1)] for k in range(_LEVELS)])
        extents = np.array(sizes, np.float32).transpose(2, 0, 1)
        wraps = np.array([[_WRAPS[mode] for mode in texture.wrap] for texture in some]).T
        nearest = np.array([texture.nearest for texture in some])
        self._library = library
        self._texels = as_array(np.concatenate(chunks))
        self._starts = as_array(np.array(starts).reshape(-1))
        self._extents = [as_array(each.reshape(-1)) for each in extents]
        self.extents = as_array(np.ascontiguousarray(extents[:, :, 0]))
        self._wraps = [as_array(np.ascontiguousarray(each)) if each.any() else None for each in wraps]
        self._nearest = as_array(nearest) if nearest.any() else None
        shares = np.arange(256, dtype=np.float32) / np.float32(255)
        self._decoded = [as_array(linear_from_srgb(shares))] * 3 + [as_array(shares)]

    def sample(self, paint: Array, texcoords: Array, level: Array) -> Array:
        """Look up colours.

        Parameters
        ----------
        paint : (P,) int64
        texcoords : (2, P) floating
            v downwards.
        level : (P,) floating
            Binary logarithm of the size of a pixel in texels, rounded down to a copy that exists.

        Returns
        -------
        (4, P) floating: linear RGB and alpha, differentiable in `texcoords`.
        """
        corners, (across, along), _ = self._around(paint, texcoords, level, range(4))
        upper, lower = (left + (right - left) * across for left, right in corners)
        return upper + (lower - upper) * along

    def alpha_slope(self, paint: Array, texcoords: Array, level: Array) -> Array:
        """Return the gradient of alpha (2, P) per texel of the picture itself; parameters as in `sample`."""
        ((a, b), (c, d)), (across, along), copy = self._around(paint, texcoords, level, (3,))
        by_u, by_v = (b - a) + (d - c - b + a) * along, (c - a) + (d - b - c + a) * across
        shrunk = [extents[copy] / whole[paint] for extents, whole in zip(self._extents, self.extents, strict=True)]
        return self._library.stack([by_u[0] * shrunk[0], by_v[0] * shrunk[1]], 0)

    def _around(
        self, paint: Array, texcoords: Array, level: Array, channels: Sequence[int]
    ) -> tuple[list[list[Array]], list[Array], Array]:
        """Return the colours (C, P) of the four texels around, in rows, the shares (P,) of the latter ones, the copy.

        A copy is a number in the tables of all paints' copies.
        """
        library = self._library
        copy = paint * _LEVELS + _whole(library.clip(library.floor(level), 0, _LEVELS - 1))
        shares, texels = [], []
        for axis in (0, 1):
            size, wraps = _taken(self._extents[axis], copy), self._wraps[axis]
            position = texcoords[axis] * size - 0.5
            if self._nearest is not None:
                position = library.where(self._nearest[paint] & (level < 0), library.round(position), position)
            low = library.floor(position)
            mode = None if wraps is None else wraps[paint]
            shares.append(position - low)
            texels.append([_whole(self._wrapped(low + step, size, mode)) for step in (0, 1)])
        width, start = _whole(_taken(self._extents[0], copy)), _taken(self._starts, copy)
        rows = [row * width + start for row in texels[1]]
        return [[self._colours(row + column, channels) for column in texels[0]] for row in rows], shares, copy

    def _wrapped(self, index: Array, count: Array, mode: Array | None) -> Array:
        """Apply each wrap mode to a texel's index, a whole floating number; None repeats everywhere."""
        library = self._library
        wrapped = index - count * library.floor(index / count)
        if mode is not None:
            twice = index - 2 * count * library.floor(index / (2 * count))
            wrapped = library.where(mode == _WRAPS["mirror"], library.minimum(twice, 2 * count - 1 - twice), wrapped)
            wrapped = library.where(mode == _WRAPS["clamp"], index, wrapped)
        # Also where the quotient is too large to be exact.
        return library.minimum(library.clip(wrapped, 0, None), count - 1)

    def _colours(self, index: Array, channels: Sequence[int]) -> Array:
        texels = _taken(self._texels, index)
        return self._library.stack([_taken(self._decoded[c], _whole(texels[:, c])) for c in channels], 0)


def _taken(table: Array, rows: Array) -> Array:
    """Return rows of a table."""
    return table.take(rows, 0) if isinstance(table, np.ndarray) else table[rows]


def _whole(values: Array) -> Array:
    """Return whole numbers as int64."""
    return values.astype(np.int64) if isinstance(values, np.ndarray) else values.long()


def _halved(pixels: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the picture and its halved copies, down to 4 pixels."""
    levels = [pixels]
    while len(levels) < _LEVELS and min(levels[-1].shape[:2]) >= 8:
        last = levels[-1]
        height, width = last.shape[0] // 2, last.shape[1] // 2
        squares = last[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 4)
        levels.append((squares.mean((1, 3), dtype=np.float32) + 0.5).astype(np.uint8))
    return levels


class BaseColours:
    """Base colours of an asset's surface; `library` and `as_array` are those of `Textures`.

    `rows`, (M,) int64: vertex of the drawn mesh of each vertex of the appearance; `faces`, (F, 3) int64: with the
    numbers of `rows`; `paint` is (F,) int64; `values`, (C, M) float32: what to interpolate: texture coordinates, and
    four vertex colours if there are some; `textured`: whether there are textures; `layers`: surfaces behind each other
    that have to be drawn at most.
    """

    def __init__(
        self, appearance: Appearance, library: Any = np, as_array: Callable[[Any], Array] = np.asarray
    ) -> None:
        paints = appearance.paints
        self._library = library
        self.rows, self.faces = as_array(appearance.rows), as_array(appearance.triangles)
        self.paint = as_array(appearance.paint_of_triangle)
        self._tinted = bool((appearance.colors != 1).any())
        tints = [appearance.colors] if self._tinted else []
        self.values = as_array(np.concatenate([appearance.texcoords, *tints], 1, dtype=np.float32).T.copy())
        self.textured = any(paint.texture is not None for paint in paints)
        self._textures = Textures([paint.texture for paint in paints], library, as_array)
        self._factor = as_array(np.array([paint.factor for paint in paints], np.float32).T.copy())
        modes = [_MODES.get(paint.alpha_mode, _BLEND) for paint in paints]
        self._mode = as_array(np.array(modes))
        self._cutoff = as_array(np.array([paint.alpha_cutoff for paint in paints], np.float32))
        self._cut = as_array(np.array([paint.texture is not None for paint in paints]) & (np.array(modes) == _MASK))
        self._has_cuts = _MASK in modes
        self.layers = MAX_LAYERS if any(modes) else 1

    def levels(self, clip: Array, faces: Array, paint: Array, side: int) -> Array:
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
        area = _double_area(self._in_pixels(clip, side)[:, faces])
        return 0.5 * self._library.log2((self._texels(faces, paint) + 1e-12) / (area + 1e-6))

    def strides(self, clip: Array, side: int) -> Array | None:
        """Return the change of texel coordinates per pixel across and along, (B, F, 2, 2); None without cut-outs."""
        if not self._has_cuts:
            return None
        library = self._library
        (a, b), (s, t) = (
            (c[..., 1, :] - c[..., 0, :], c[..., 2, :] - c[..., 0, :])
            for c in (self._in_pixels(clip, side)[:, self.faces], self._at_corners(self.faces, self.paint))
        )
        double_area = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        divisor = library.where(abs(double_area) > 1e-6, double_area, 1e-6)[..., None]
        right = (s * b[..., 1:] - t * a[..., 1:]) / divisor
        down = (t * a[..., :1] - s * b[..., :1]) / divisor
        return library.stack([right, down], -2)

    def texel_areas(self) -> Array:
        """Return the areas (F,) of the faces in texels."""
        return self._texels(self.faces, self.paint) / 2

    def _in_pixels(self, clip: Array, side: int) -> Array:
        """Return where vertices are in the picture, in pixels."""
        return clip[..., :2] / self._library.clip(clip[..., 3:], 1e-6, None) * (side / 2)

    def _at_corners(self, faces: Array, paint: Array) -> Array:
        """Return the texel coordinates (F, 3, 2) of the corners of faces."""
        return self.values[:2].T[faces] * self._textures.extents.T[paint][:, None]

    def _texels(self, faces: Array, paint: Array) -> Array:
        return _double_area(self._at_corners(faces, paint))

    def colours(self, paint: Array, values: Array, level: Array) -> Array:
        """Return linear RGB and alpha (4, P) for interpolated values (C, P); alpha as the file has it."""
        colour = self._factor[:, paint]
        if self._tinted:
            colour = colour * values[2:]
        return colour * self._textures.sample(paint, values[:2], level) if self.textured else colour

    def opacity(self, paint: Array, colour: Array) -> Array:
        """Return the share (P,) of the surface that hides what is behind; 0 or 1 in cut-outs."""
        library = self._library
        alpha, mode = colour[3], self._mode[paint]
        whole = library.ones_like(alpha)
        alpha = library.where(mode == _MASK, (alpha >= self._cutoff[paint]) * whole, library.clip(alpha, 0, 1))
        return library.where(mode == _OPAQUE, whole, alpha)

    def edge_widths(self, paint: Array, values: Array, level: Array, stride: Array | None) -> Array | None:
        """Return the change of alpha (P,) per pixel at cut-outs, 0 elsewhere; `stride` is (P, 2, 2) of `strides`."""
        if stride is None:
            return None
        cut = self._library.argwhere(self._cut[paint])[:, 0]
        width = self._library.zeros_like(values[0])
        paint = paint[cut]
        slope = self._textures.alpha_slope(paint, values[:2, cut], level[cut])
        by_pixel = [stride[cut, k, 0] * slope[0] + stride[cut, k, 1] * slope[1] for k in (0, 1)]
        # Not wider than what keeps alpha 0 removed and alpha 1 whole.
        cutoff = self._cutoff[paint]
        most = 2 * self._library.minimum(cutoff, 1 - cutoff)
        change = (by_pixel[0] ** 2 + by_pixel[1] ** 2) ** 0.5 * self._factor[3, paint]
        width[cut] = self._library.minimum(change * values[5, cut] if self._tinted else change, most)
        return width

    def coverage(self, paint: Array, colour: Array, width: Array | None) -> Array:
        """Return `opacity` (P,), but at the edge of a cut-out the share that is left; `width` is from `edge_widths`."""
        opacity = self.opacity(paint, colour)
        if width is None:
            return opacity
        edge = width > _STEEP
        share = (colour[3] - self._cutoff[paint]) / self._library.where(edge, width, 1.0) + 0.5
        return self._library.where(edge, self._library.clip(share, 0, 1), opacity)


def _double_area(corners: Array) -> Array:
    """Return twice the area of triangles (..., 3, 2)."""
    a, b = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    return abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
