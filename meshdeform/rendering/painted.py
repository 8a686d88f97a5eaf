"""Draw an asset as its file describes it: base colours, its own normals, cut-outs and transparency.

Light comes with the camera (from the upper left, weaker from the right) and from sky and ground, so no side is black.
Surfaces are matt. The nearest surface is drawn first; where it is transparent, the next one behind it, and so on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.srgb import linear_from_srgb, srgb_from_linear
from meshdeform.rendering.base_colours import OPAQUE_ENOUGH, BaseColours
from meshdeform.rendering.cameras import Cameras
from meshdeform.rendering.visibility import FacePlanes, interpolated, nearest_faces

_KEY, _FILL = (-0.45, 0.65, 0.60), (0.75, 0.05, 0.65)  # in the camera's frame: x right, y up, z towards the viewer
_KEY_LIGHT, _FILL_LIGHT = 0.80, 0.16
_SKY, _GROUND = 0.32, 0.14
_INFINITE = 9.0

_Singles = NDArray[np.float32]
_Index = NDArray[np.int64]


@dataclass(frozen=True)
class PaintedStyle:
    """Style of the views."""

    view_size: int = 256  # side of a view in pixels
    supersample: int = 2  # views are rendered at ``view_size * supersample`` pixels and averaged down
    background: tuple[float, float, float] = (0.93, 0.93, 0.93)  # sRGB; used if `render` is given no other background


class PaintedRenderer:
    """Renders deformed states of one asset."""

    def __init__(self, appearance: Appearance, style: PaintedStyle) -> None:
        self.style = style
        self._colours = BaseColours(appearance)
        self._double_sided = np.array([paint.double_sided for paint in appearance.paints])
        self._unlit = np.array([paint.unlit for paint in appearance.paints])

    def render(
        self, positions: NDArray[np.floating], normals: NDArray[np.floating], cameras: Cameras,
        backdrops: _Singles | None = None,
    ) -> _Singles:  # fmt: skip
        """Render the asset from every camera.

        Parameters
        ----------
        positions : (N, 3) floating
            Positions of the surface's vertices in the cameras' frame.
        normals : (N, 3) floating
            Unit normals; NaN where there is none: faces there are flat.
        cameras : Cameras
            B cameras.
        backdrops : (B, view_size, view_size, 3) float32 in [0, 1], optional
            sRGB pictures behind the asset.

        Returns
        -------
        (B, view_size, view_size, 3) float32 in [0, 1], sRGB.
        """
        if backdrops is None:
            shape = (len(cameras.view_proj), self.style.view_size, self.style.view_size, 3)
            backdrops = np.broadcast_to(np.array(self.style.background, np.float32), shape)
        surface = _Surface.of(positions, normals, self._colours)
        clip, front = cameras.project(surface.verts), surface.planes.heights(cameras.eye) >= 0
        views = zip(clip, front, cameras.view[:, :3, :3], backdrops, strict=True)
        return np.stack([self._render(surface, *each) for each in views])

    def _render(
        self, surface: _Surface, clip: _Singles, front: NDArray[np.bool_], axes: _Singles, backdrop: _Singles
    ) -> _Singles:
        size, factor = self.style.view_size, self.style.supersample
        side = size * factor
        drawn = np.flatnonzero(front | self._double_sided[self._colours.paint])
        faces = self._colours.faces if len(drawn) == len(front) else self._colours.faces[drawn]
        squares, through = _Squares(size, factor), np.ones(side * side, np.float32)
        behind: _Singles | None = None
        for _ in range(self._colours.layers):
            found, depth = nearest_faces(clip[None], faces, side, side, behind)
            pixels = np.flatnonzero(found.ravel() >= 0)
            seen = drawn[found.ravel()[pixels]]
            colour = self._shaded(surface, clip, pixels, seen, front, axes)
            if self._colours.layers == 1:
                squares.add(pixels, colour[:3], None)
                break
            before = through[pixels]
            share = before * self._colours.opacity(self._colours.paint[seen], colour)
            squares.add(pixels, colour[:3], share)
            through[pixels] = before - share
            open_ = (through.reshape(depth.shape) > 1 - OPAQUE_ENOUGH) & (found >= 0)
            if not open_.any():
                break
            behind = np.where(open_, depth, np.float32(_INFINITE))
        return squares.over(backdrop)

    def _shaded(
        self, surface: _Surface, clip: _Singles, pixels: _Index, face: _Index, front: NDArray[np.bool_], axes: _Singles
    ) -> _Singles:
        """Return linear light and alpha (4, P) of the faces (P,) that are seen at pixels."""
        side = self.style.view_size * self.style.supersample
        shown = np.zeros(len(front), bool)
        shown[face] = True
        kept = np.flatnonzero(shown)
        number = np.empty(len(front), np.int64)
        number[kept] = np.arange(len(kept))
        which, corners = number.take(face), self._colours.faces[kept]
        at = interpolated(clip, surface.values, corners, pixels, which, side, side)
        normal = surface.unit_normals(at, face) * np.where(front, np.float32(1), np.float32(-1)).take(face)
        paint = self._colours.paint.take(face)
        level = None
        if self._colours.textured:
            level = self._colours.levels(clip[None], corners, self._colours.paint[kept], side)[0].take(which)
        colour: _Singles = self._colours.colours(paint, at[surface.normal_rows :], level)
        light = _lit(normal, axes)
        colour[:3] *= np.where(self._unlit[paint], np.float32(1), light) if self._unlit.any() else light
        return colour


@dataclass(frozen=True)
class _Surface:
    """One state of the surface.

    `verts`, (M, 3): of the vertices of the appearance. `values`, (C, M): what is interpolated: `normal_rows` of the
    normals, and of 1 where the file has one if it lacks some, and then the values of the colours.
    """

    verts: _Singles
    values: _Singles
    normal_rows: int
    planes: FacePlanes

    @classmethod
    def of(cls, positions: NDArray[np.floating], normals: NDArray[np.floating], colours: BaseColours) -> _Surface:
        """Return the surface with positions and normals (N, 3)."""
        verts: _Singles = positions.astype(np.float32)[colours.rows]
        given: _Singles = normals.astype(np.float32)[colours.rows].T
        defined = np.isfinite(given).all(0, keepdims=True)
        if not defined.all():
            given = np.concatenate([np.where(defined, given, np.float32(0)), defined])
        values = np.concatenate([given, colours.values], dtype=np.float32)
        return cls(verts, values, len(given), FacePlanes.of(verts, colours.faces))

    def unit_normals(self, at: _Singles, face: _Index) -> _Singles:
        """Return unit normals (3, P) at pixels of faces (P,) with interpolated values (C, P)."""
        normal = at[:3]
        length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        usable = length > 1e-3
        if self.normal_rows == 4:
            usable &= at[3] > 0.999
        normal = np.asarray(normal / np.where(usable, length, np.float32(1)), np.float32)
        flat = np.flatnonzero(~usable)
        if len(flat):
            cross = self.planes.normals.take(face.take(flat), 1)
            normal[:, flat] = cross / np.maximum(np.linalg.norm(cross, axis=0), np.float32(1e-20))
        return normal


def _lit(normal: _Singles, axes: _Singles) -> _Singles:
    """Return the light (P,) on surfaces with unit normals (3, P) in the world; `axes` rotates to the camera."""
    light: _Singles = _GROUND + (_SKY - _GROUND) * ((1 + normal[1]) / 2)
    for direction, strength in ((_KEY, _KEY_LIGHT), (_FILL, _FILL_LIGHT)):
        towards = (np.array(direction) / np.linalg.norm(direction) @ axes).astype(np.float32)
        light += strength * np.maximum(towards @ normal, 0)
    return light


class _Squares:
    """Sums of light over the squares of pixels that become one pixel of a picture (size, size)."""

    def __init__(self, size: int, factor: int) -> None:
        self._size, self._factor = size, factor
        self._light, self._covered = np.zeros((3, size * size)), np.zeros(size * size)

    def add(self, pixels: _Index, light: _Singles, share: _Singles | None) -> None:
        """Add light (3, P) at pixels (P,), each of which covers a share (P,), by default 1, of what is behind."""
        row, column = np.divmod(pixels, self._size * self._factor)
        square = row // self._factor * self._size + column // self._factor
        count = self._size * self._size
        self._covered += np.bincount(square, share, count)
        for total, channel in zip(self._light, light if share is None else light * share, strict=True):
            total += np.bincount(square, channel, count)

    def over(self, backdrop: _Singles) -> _Singles:
        """Return the picture (size, size, 3) in front of a backdrop, both sRGB."""
        picture = backdrop.reshape(-1, 3).copy()
        some = np.flatnonzero(self._covered)
        light, covered = (
            (each[..., some] / self._factor**2).astype(np.float32) for each in (self._light, self._covered)
        )
        light += (1 - covered) * linear_from_srgb(picture[some].T)
        picture[some] = srgb_from_linear(np.clip(light, 0, 1)).T
        return picture.reshape(backdrop.shape)
