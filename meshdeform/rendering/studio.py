"""Photograph an asset for people: cameras that frame it closely, a light background, a soft shadow on the ground.

`preview.png` shows the asset before (upper row) and after (lower row), from four sides. How the asset itself is drawn
is told in `painted.py`.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from meshdeform.assets import Limits, load_asset
from meshdeform.geometry.appearance import Appearance
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.painted import PaintedRenderer, PaintedStyle
from meshdeform.rendering.visibility import nearest_faces

_FOV_DEG = 28.0
_ELEVATION_DEG = 15.0

_MARGIN = 0.9
"""Share of the view that the asset may fill."""

_UPPER, _LOWER = (0.965, 0.968, 0.972), (0.885, 0.89, 0.90)
_PLAIN = (0.94, 0.945, 0.95)
_SHADOW = 0.42
_SHADOW_SIZE = 96
_SHADOW_REACH = 1.3
_SHADOW_BLURS = (5, 9, 9)

_Singles = NDArray[np.float32]
_SIZE = 256
_AZIMUTHS_DEG = (30.0, 120.0, 210.0, 300.0)
FORMATS = {".webp": "WEBP", ".gif": "GIF"}
"""Formats by file suffix."""
_SIZES = {"WEBP": 320, "GIF": 256}
_FRAME_MS, _PAUSE_MS = 60, 800
_FROM_DEG, _FRONT_DEG, _TO_DEG = 5.0, 30.0, 55.0


@dataclass(frozen=True)
class SurfaceState:
    """One state of the surface: positions and normals (N, 3) float64; NaN where a vertex has no normal."""

    positions: NDArray[np.float64]
    normals: NDArray[np.float64]


class Studio:
    """Draws states of one asset at one scale.

    Parameters
    ----------
    poses : sequence of SurfaceState
        The states that must fit the views.
    size : int
        Side of a view in pixels.
    azimuths_deg : sequence of float
        Views that every pose must fit.
    plain : bool
        Whether the background is one colour without a shadow, for formats of few colours.
    """

    def __init__(
        self,
        appearance: Appearance,
        poses: Sequence[SurfaceState],
        *,
        size: int,
        azimuths_deg: Sequence[float],
        plain: bool = False,
    ) -> None:
        self._renderer = PaintedRenderer(appearance, PaintedStyle(size))
        self._size, self._plain = size, plain
        self._used = np.flatnonzero(np.bincount(appearance.rows))
        self._faces = appearance.rows[appearance.triangles]
        shown = np.concatenate([pose.positions[self._used] for pose in poses])
        self._centre = (shown.min(0) + shown.max(0)) / 2
        shown -= self._centre
        self._scale = 1 / max(float(np.linalg.norm(shown, axis=1).max()), 1e-300)
        self._framing = _framing(self._cameras(azimuths_deg), (shown * self._scale).astype(np.float32))

    def photograph(self, pose: SurfaceState, azimuths_deg: Sequence[float]) -> NDArray[np.uint8]:
        """Draw a state from several sides.

        Returns
        -------
        (B, size, size, 3) uint8
        """
        positions = ((pose.positions - self._centre) * self._scale).astype(np.float32)
        cameras = self._cameras(azimuths_deg)
        cameras = replace(cameras, view_proj=self._framing @ cameras.view_proj)
        backdrops = self._backdrops(cameras, positions)
        views = self._renderer.render(positions, pose.normals, cameras, backdrops)
        return np.rint(views * 255).astype(np.uint8)

    def _cameras(self, azimuths_deg: Sequence[float]) -> Cameras:
        return fixed_cameras(tuple(float(a) for a in azimuths_deg), _ELEVATION_DEG, _FOV_DEG)

    def _backdrops(self, cameras: Cameras, positions: _Singles) -> _Singles:
        """Return the backgrounds (B, size, size, 3) of views of a state."""
        if self._plain:
            shape = (len(cameras.view_proj), self._size, self._size, 3)
            return np.broadcast_to(np.array(_PLAIN, np.float32), shape)
        shadow, ground = self._shadow(positions), float(positions[self._used, 1].min())
        return np.stack([self._backdrop(each, shadow, ground) for each in cameras.view_proj])

    def _shadow(self, positions: _Singles) -> _Singles:
        """Return the darkness (H, W) of the ground: dark under what is near it."""
        height = positions[:, 1] - positions[self._used, 1].min()
        flat = positions[:, [0, 2]] / np.float32(_SHADOW_REACH)
        # From below, orthographic: the nearest surface is the lowest one.
        clip = np.stack([flat[:, 0], -flat[:, 1], height / 2 - np.float32(0.5), np.ones_like(height)], 1)[None]
        depth = nearest_faces(clip, self._faces, _SHADOW_SIZE, _SHADOW_SIZE)[1][0]
        dark = np.where(depth <= 1, np.exp(-2.5 * np.maximum(2 * depth + 1, 0)), np.float32(0))
        for width in _SHADOW_BLURS:
            dark = _blurred(_blurred(dark, width).T, width).T
        return dark

    def _backdrop(self, view_proj: _Singles, shadow: _Singles, ground: float) -> _Singles:
        """Return the background (size, size, 3) of one view."""
        at = (np.arange(self._size, dtype=np.float32) + 0.5) * 2 / self._size - 1
        back = np.linalg.inv(view_proj.astype(np.float64)).astype(np.float32)
        # Lines of sight from the near to the far plane, as rows and columns that are added up.
        near, far = ([at * row[0] - at[:, None] * row[1] + (z * row[2] + row[3]) for row in back] for z in (-1.0, 1.0))
        near, far = ([each / points[3] for each in points[:3]] for points in (near, far))
        along = (ground - near[1]) / (far[1] - near[1])
        x, z = ((near[axis] + along * (far[axis] - near[axis])) / _SHADOW_REACH for axis in (0, 2))
        dark = np.where(along > 0, _looked_up(shadow, x, z), 0)
        share = ((1 + at) / 2)[:, None, None]
        base = np.array(_UPPER, np.float32) * (1 - share) + np.array(_LOWER, np.float32) * share
        return np.asarray(base * (1 - _SHADOW * dark[..., None]), np.float32)


def _blurred(picture: _Singles, width: int) -> _Singles:
    """Return the means of so many values in a row around each of (H, W); beyond the borders there are zeros."""
    sums = np.cumsum(np.pad(picture, ((0, 0), (width // 2 + 1, width // 2))), 1, dtype=np.float64)
    return ((sums[:, width:] - sums[:, :-width]) / width).astype(np.float32)


def _looked_up(picture: _Singles, x: _Singles, y: _Singles) -> _Singles:
    """Look up a picture (S, S), which fills -1 .. 1, at points (H, W) each, bilinearly; beyond it there are zeros."""
    side = len(picture)
    column, row = (np.clip((np.nan_to_num(each, nan=9.0) + 1) * (side / 2) + 0.5, 0, side + 0.999) for each in (x, y))
    left, above = column.astype(np.int64), row.astype(np.int64)
    across, down = column - left, row - above
    padded = np.pad(picture, ((1, 2), (1, 2)))
    at = above * padded.shape[1] + left
    one, two, three, four = (padded.ravel().take(at + step) for step in (0, 1, padded.shape[1], padded.shape[1] + 1))
    upper, lower = one + (two - one) * across, three + (four - three) * across
    found: _Singles = upper + (lower - upper) * down
    return found


def _framing(cameras: Cameras, points: _Singles) -> _Singles:
    """Return the change (4, 4) of clip space that makes points (P, 3) fill all views; the horizontal centre stays."""
    low, high, wide = math.inf, -math.inf, 1e-6
    for clip in cameras.project(points):
        x, y = clip[:, 0] / clip[:, 3], clip[:, 1] / clip[:, 3]
        low, high, wide = min(low, float(y.min())), max(high, float(y.max())), max(wide, float(np.abs(x).max()))
    zoom = _MARGIN / max(wide, (high - low) / 2)
    change = np.diag([zoom, zoom, 1.0, 1.0]).astype(np.float32)
    change[1, 3] = -zoom * (low + high) / 2
    return change


def preview_png(appearance: Appearance, source: SurfaceState, result: SurfaceState) -> bytes:
    """Draw both states with the asset's colours and normals, at the same scale, so that growth is visible.

    Returns
    -------
    A PNG of 1024 x 512 pixels: front, left, back and right of the source above and of the result below.
    """
    studio = Studio(appearance, (source, result), size=_SIZE, azimuths_deg=_AZIMUTHS_DEG)
    rows = [np.concatenate(list(studio.photograph(pose, _AZIMUTHS_DEG)), 1) for pose in (source, result)]
    return _labelled(rows, ("source", "result"))


def comparison_png(glbs: Mapping[str, bytes]) -> bytes:
    """Draw assets that need not have the same triangles, one in each row under its name, from four sides."""
    rows = []
    for data in glbs.values():
        asset = load_asset(data, limits=Limits.unlimited())
        pose = SurfaceState(asset.surface.positions, asset.surface.normals)
        studio = Studio(asset.appearance(), (pose,), size=_SIZE, azimuths_deg=_AZIMUTHS_DEG)
        rows.append(np.concatenate(list(studio.photograph(pose, _AZIMUTHS_DEG)), 1))
    return _labelled(rows, list(glbs))


def _labelled(rows: Sequence[NDArray[np.uint8]], labels: Sequence[str]) -> bytes:
    image = Image.fromarray(np.ascontiguousarray(np.concatenate(rows)), "RGB")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(13)
    for row, label in enumerate(labels):
        # At the end of the row: the web page shows its beginning as a thumbnail.
        draw.text((image.width - 9, row * _SIZE + 6), label, fill=(110, 112, 118), font=font, anchor="ra")
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()


def morph_animation(
    appearance: Appearance,
    source: SurfaceState,
    result: SurfaceState,
    *,
    kind: str,
    size: int | None = None,
    frames: int = 24,
) -> bytes:
    """Draw the way from the source to the result and back, with a pause at each end, while the camera swings.

    Parameters
    ----------
    size : int, optional
        Side in pixels; by default 320, and 256 for the less compact GIF.
    frames : int
        From one end to the other.
    """
    ways = [(1 - math.cos(math.pi * k / (frames - 1))) / 2 for k in range(frames)]
    azimuths = [_FROM_DEG + (_TO_DEG - _FROM_DEG) * way for way in ways]
    studio = Studio(
        appearance,
        (source, result),
        size=size or _SIZES[kind],
        azimuths_deg=azimuths[:: max(1, frames // 4)],
        plain=kind == "GIF",
    )
    there = [
        studio.photograph(_between(source, result, way), (azimuth,))[0]
        for way, azimuth in zip(ways, azimuths, strict=True)
    ]
    times = [_PAUSE_MS, *[_FRAME_MS] * (frames - 2), _PAUSE_MS]
    return _written([*there, *there[-2:0:-1]], [*times, *times[-2:0:-1]], kind)


def turntable_animation(
    appearance: Appearance, pose: SurfaceState, *, kind: str, size: int | None = None, frames: int = 48
) -> bytes:
    """Draw one turn about the vertical axis; the parameters are those of `morph_animation`."""
    azimuths = [_FRONT_DEG + 360 * k / frames for k in range(frames)]
    studio = Studio(
        appearance,
        (pose,),
        size=size or _SIZES[kind],
        azimuths_deg=azimuths[:: max(1, frames // 12)],
        plain=kind == "GIF",
    )
    return _written([studio.photograph(pose, (azimuth,))[0] for azimuth in azimuths], [_FRAME_MS] * frames, kind)


def _between(source: SurfaceState, result: SurfaceState, way: float) -> SurfaceState:
    """Return the state at a share of the way from the source to the result."""
    normals = (1 - way) * source.normals + way * result.normals
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return SurfaceState(
        (1 - way) * source.positions + way * result.positions,
        np.divide(normals, length, out=np.full_like(normals, np.nan), where=length > 1e-9),
    )


def _written(frames: Sequence[NDArray[np.uint8]], times: list[int], kind: str) -> bytes:
    images = [Image.fromarray(frame, "RGB") for frame in frames]
    options: dict[str, object] = {"quality": 80, "method": 2}
    if kind == "GIF":
        # One palette for all frames and no dithering: what does not change costs nothing.
        palette = _strip(images).quantize(255, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
        options = {"optimize": False, "disposal": 1}
    out = io.BytesIO()
    images[0].save(out, kind, save_all=True, append_images=images[1:], duration=times, loop=0, **options)
    return out.getvalue()


def _strip(images: Sequence[Image.Image]) -> Image.Image:
    """Return up to six of the frames side by side."""
    some = images[:: max(1, len(images) // 6)]
    strip = Image.new("RGB", (sum(image.width for image in some), some[0].height))
    for k, image in enumerate(some):
        strip.paste(image, (k * image.width, 0))
    return strip
