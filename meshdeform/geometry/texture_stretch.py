"""Measure how much a result's texture is stretched.

Of the map from the texture to a triangle, affine with the partial derivatives S_u and S_v, the larger singular value is
the length to which the texture is drawn out in its worst direction (the L-infinity stretch of Sander et al.)::

    a = S_u . S_u,  b = S_u . S_v,  c = S_v . S_v
    Gamma = sqrt((a + c + sqrt((a - c)^2 + 4 b^2)) / 2)
    stretch = (Gamma' / Gamma) / s,     s = sqrt(area' / area) of the whole textured surface

with a prime for the result. Division by the mean growth `s` makes it free of scale, as theirs is: a similarity of the
whole surface has 1, and a point where texels became twice as long as `s` explains has 2. Where they became shorter, it
is below 1. Lengths in the texture are in texels. Triangles without a texture, or without an area in it, do not count.

Source: Sander et al. 2001, Texture Mapping Progressive Meshes, section 3.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.appearance import Appearance

_Floats = NDArray[np.float64]
_STRONG = 2.0
_FLAT = 1e-9
"""Area in the texture, in texels, below which a triangle shows one colour."""


@dataclass(frozen=True)
class TextureStretch:
    """Stretch of a result's texture; percentiles and shares are of the result's measured area."""

    # Percentiles of the stretch
    p50: float
    p95: float
    above_2: float  # share with a stretch above 2
    scale: float  # s: how much longer the measured surface became on average
    measured: float  # share of the source's area that has a texture and was measured

    def to_dict(self) -> dict[str, float]:
        """Return the values by name, rounded."""
        return {name: round(value, 4) for name, value in asdict(self).items()}


def texel_corners(appearance: Appearance) -> _Floats:
    """Return the corners (T, 3, 2) of all triangles in their texture, in texels; NaN where there is none."""
    sizes = np.array(
        [(np.nan, np.nan) if p.texture is None else p.texture.pixels.shape[1::-1] for p in appearance.paints], float
    )
    corners: _Floats = appearance.texcoords[appearance.triangles] * sizes[appearance.paint_of_triangle][:, None]
    return corners


def face_stretch(texels: _Floats, before: _Floats, after: _Floats) -> tuple[_Floats, float]:
    """Return the stretch (T,) of triangles, NaN where it is not defined, and s.

    `texels`, (T, 3, 2): corners in the texture; NaN for triangles without one. `before` and `after`, (T, 3, 3): corners
    on the source and on the result.
    """
    old, new = _largest(texels, before), _largest(texels, after)
    valid = (old > 0) & np.isfinite(old) & np.isfinite(new)
    if not valid.any():
        return np.full(len(texels), np.nan), 1.0
    scale = float(np.sqrt(_areas(after)[valid].sum() / _areas(before)[valid].sum()))
    stretch = np.full(len(texels), np.nan)
    np.divide(new, old * max(scale, 1e-300), out=stretch, where=valid)
    return stretch, scale


def measure_texture_stretch(texels: _Floats, before: _Floats, after: _Floats) -> TextureStretch | None:
    """Measure the stretch; None if no triangle has a texture. The parameters are those of `face_stretch`."""
    values, scale = face_stretch(texels, before, after)
    valid = np.isfinite(values)
    old, new = _areas(before), _areas(after)
    if not valid.any() or new[valid].sum() <= 0:
        return None
    order = np.argsort(values[valid], kind="stable")
    sorted_values, weights = values[valid][order], new[valid][order]
    share = np.cumsum(weights) / weights.sum()
    p50, p95 = (float(sorted_values[np.searchsorted(share, q - 1e-12)]) for q in (0.5, 0.95))
    above = float(weights[sorted_values > _STRONG].sum() / weights.sum())
    return TextureStretch(p50, p95, above, scale, float(old[valid].sum() / old.sum()))


def _largest(texels: _Floats, points: _Floats) -> _Floats:
    """Return Gamma (T,), NaN without an area in the texture."""
    (u1, v1), (u2, v2) = (np.moveaxis(texels[:, k] - texels[:, 0], 1, 0) for k in (1, 2))
    first, second = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    double_area = u1 * v2 - u2 * v1
    divisor = np.where(np.abs(double_area) > 2 * _FLAT, double_area, np.nan)[:, None]
    along_u = (first * v2[:, None] - second * v1[:, None]) / divisor
    along_v = (second * u1[:, None] - first * u2[:, None]) / divisor
    a, b, c = (along_u**2).sum(1), (along_u * along_v).sum(1), (along_v**2).sum(1)
    largest: _Floats = np.sqrt((a + c + np.sqrt((a - c) ** 2 + 4 * b**2)) / 2)
    return largest


def _areas(points: _Floats) -> _Floats:
    """Return the area (T,) of triangles with these corners (T, 3, 3)."""
    areas: _Floats = np.linalg.norm(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1) / 2
    return areas
