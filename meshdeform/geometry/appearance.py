"""Define how a surface looks, for drawing it: base colours, texture coordinates and vertex colours. Without torch."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

CLAY = (0.46, 0.44, 0.42, 1.0)
"""Linear colour of a surface that the file gives none."""

_SAME = 0.03
"""Difference between encoded colours that nobody sees; `CLAY` is a grey by this."""


@dataclass(frozen=True)
class Texture:
    """A decoded base colour texture."""

    pixels: NDArray[np.uint8]  # (H, W, 4) uint8: sRGB and alpha; the first row is the upper one, at v = 0
    wrap: tuple[str, str] = ("repeat", "repeat")  # `repeat`, `clamp` or `mirror`, for u and v
    nearest: bool = False  # whether magnified texels stay squares
    reduced: bool = True  # whether distant faces may show reduced copies of the picture


@dataclass(frozen=True)
class Paint:
    """Look of the triangles of one material."""

    factor: tuple[float, ...] = CLAY  # linear RGBA, multiplied by the texture and the vertex colours
    texture: Texture | None = None
    alpha_mode: str = "OPAQUE"  # `OPAQUE`, `MASK` or `BLEND`
    alpha_cutoff: float = 0.5
    double_sided: bool = True  # whether the back of a triangle is visible
    unlit: bool = False  # whether colours are shown without lighting


@dataclass(frozen=True)
class Appearance:
    """Look of an asset's surface.

    Vertices are split where a shared vertex has different attributes in two primitives, so they have numbers of their
    own: vertex m of a picture is vertex ``rows[m]`` of the surface.
    """

    rows: NDArray[np.int64]  # (M,) int64
    triangles: NDArray[np.int64]  # (T, 3) int64: in the order of `Surface.triangles`, with the numbers of `rows`
    texcoords: NDArray[np.float32]  # (M, 2) float32: after the texture transform; v downwards
    colors: NDArray[np.float32]  # (M, 4) float32: linear vertex colours; 1 if the file has none
    paint_of_triangle: NDArray[np.int64]  # (T,) int64
    paints: tuple[Paint, ...]
    left_out: dict[str, int] = field(default_factory=dict)  # what could not be read, with counts

    def of_triangles(self, chosen: NDArray[np.bool_]) -> Appearance:
        """Return the look of some of the triangles (T,), with the vertices that they use."""
        if chosen.all():
            return self
        used, triangles = np.unique(self.triangles[chosen], return_inverse=True)
        return dataclasses.replace(
            self,
            rows=self.rows[used],
            triangles=triangles.reshape(-1, 3),
            texcoords=self.texcoords[used],
            colors=self.colors[used],
            paint_of_triangle=self.paint_of_triangle[chosen],
        )

    @property
    def coloured(self) -> bool:
        """Whether the surface shows more than one grey."""
        shown = [_single_colour(self.paints[at]) for at in np.unique(self.paint_of_triangle)]
        if any(colour is None for colour in shown):
            return True
        factors = np.array([_single_colour(paint) or (0.0, 0.0, 0.0) for paint in self.paints])
        colours = (self.colors[self.triangles][..., :3] * factors[self.paint_of_triangle][:, None]) ** (1 / 2.2)
        return bool(np.ptp(colours.reshape(-1, 3), axis=0).max() > _SAME or np.ptp(colours, axis=2).max() > _SAME)


def _single_colour(paint: Paint) -> tuple[float, ...] | None:
    """Return the colour of a paint, or None if its texture has more than one."""
    if paint.texture is None:
        return paint.factor[:3]
    pixels = paint.texture.pixels
    if (pixels != pixels[0, 0]).any():
        return None
    return tuple(float(f * (v / 255) ** 2.2) for f, v in zip(paint.factor, pixels[0, 0, :3], strict=False))
