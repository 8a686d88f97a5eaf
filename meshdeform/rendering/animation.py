"""Draw an animated picture of an asset: from its source to the result and back, or a turn about the vertical axis."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from meshdeform.geometry.appearance import Appearance
from meshdeform.rendering.studio import Pose, Studio

FORMATS = {".webp": "WEBP", ".gif": "GIF"}
"""Formats by file suffix."""

_SIZES = {"WEBP": 320, "GIF": 256}
_FRAME_MS, _PAUSE_MS = 60, 800
_FROM_DEG, _TO_DEG = 5.0, 55.0
_FRONT_DEG = 30.0


def morph_animation(
    appearance: Appearance, source: Pose, result: Pose, *, kind: str, size: int | None = None, frames: int = 24
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
    appearance: Appearance, pose: Pose, *, kind: str, size: int | None = None, frames: int = 48
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


def _between(source: Pose, result: Pose, way: float) -> Pose:
    """Return the state at a share of the way from the source to the result."""
    normals = (1 - way) * source.normals + way * result.normals
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Pose(
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
