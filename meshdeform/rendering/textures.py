"""Look up base colours: all textures of an asset in one array, with their halved copies, filtered bilinearly.

A face uses the copy whose texels are about as large as its pixels, so that fine patterns do not flicker. Wrap modes are
those of the sampler. Colours are decoded from sRGB before they are mixed.

Source: Williams 1983, Pyramidal Parametrics (the halved copies); glTF 2.0 specification, section 3.8.4 (samplers).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.assets.appearance import Texture

__all__ = ["Textures", "linear_from_srgb", "srgb_from_linear"]

_WRAPS = {"repeat": 0, "clamp": 1, "mirror": 2}
_LEVELS = 11
_WHITE = Texture(np.full((1, 1, 4), 255, np.uint8))


class Textures:
    """The textures of an asset's paints.

    Parameters
    ----------
    textures : sequence of Texture or None
        One per paint; None is white.
    device : str or torch.device
    """

    def __init__(self, textures: Sequence[Texture | None], device: torch.device | str = "cpu") -> None:
        starts, sizes, chunks, at = [], [], [], 0
        shared: dict[int, tuple[list[int], list[tuple[int, int]]]] = {}
        for texture in (found or _WHITE for found in textures):
            if id(texture.pixels) not in shared:
                levels = _halved(texture.pixels) if texture.reduced else [texture.pixels]
                place = [at + sum(level.shape[0] * level.shape[1] for level in levels[:k]) for k in range(len(levels))]
                shared[id(texture.pixels)] = place, [level.shape[:2] for level in levels]
                chunks += [level.reshape(-1, 4) for level in levels]
                at += sum(level.shape[0] * level.shape[1] for level in levels)
            place, size = shared[id(texture.pixels)]
            starts.append([place[min(k, len(place) - 1)] for k in range(_LEVELS)])
            sizes.append([size[min(k, len(size) - 1)] for k in range(_LEVELS)])
        wraps = [[_WRAPS[mode] for mode in (found or _WHITE).wrap] for found in textures]
        self._texels = torch.from_numpy(np.concatenate(chunks)).to(device)
        self._starts = torch.tensor(starts, device=device)
        self._sizes = torch.tensor(sizes, device=device)
        self._wraps = torch.tensor(wraps, device=device)
        self._nearest = torch.tensor([found is not None and found.nearest for found in textures], device=device)
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
