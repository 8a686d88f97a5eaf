"""Read a picture as a silhouette: a mask, or a photograph or drawing of an object in front of a plain background.

Where a picture has a transparent background, its opacity is the silhouette. Elsewhere the background's colour is the
median of the picture's border, and the object is what differs from it by more than Otsu's threshold.

Source of the threshold: Otsu 1979, A threshold selection method from gray-level histograms.
"""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter, ImageOps

from meshdeform.assets.inspect import PictureSummary
from meshdeform.errors import AssetTooLargeError, SilhouetteError

_FORMATS = ("PNG", "JPEG", "WEBP")
_MAX_PIXELS = 64 * 1024 * 1024
_SIDE = 512
"""Longest side at which silhouettes are kept; pictures for the comparison are smaller."""
_BORDER = 0.02
"""Width of the border that shows the background, as a share of the shorter side."""
_NOISE = 24
"""Differences of colours, 0 to 255, that count as none: noise, compression, soft shadows."""
_LEAST_PLAIN = 0.7
"""Least share of the border that has the background's colour."""
_OPAQUE = 128
_LEAST_EXTENT = 16
"""Least extent of a silhouette in pixels."""
_LARGEST_SHARE = 0.98
_FAILURES = (OSError, ValueError, SyntaxError, MemoryError, Image.DecompressionBombError)


@dataclass(frozen=True)
class SilhouettePicture:
    """A silhouette."""

    mask: NDArray[np.bool_]  # (H, W) bool: covered pixels, row 0 at the top; at most 512 x 512
    summary: PictureSummary


def read_silhouette(data: bytes, name: str = "The picture") -> SilhouettePicture:
    """Find the silhouette in a picture.

    `data`: PNG, JPEG or WebP. A photograph is turned upright as its EXIF says. `name`: what errors call the picture.
    """
    with warnings.catch_warnings():
        # Our own limit is checked below, before anything is decoded.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        picture, kind, size = _decoded(data, name)
    mask = _of_opacity(picture)
    if mask is None:
        mask = _of_colours(picture.convert("RGB"), name)
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows) or min(np.ptp(rows), np.ptp(columns)) + 1 < _LEAST_EXTENT * min(mask.shape) / _SIDE:
        raise SilhouetteError(
            f"{name} shows no object: nothing in it differs from its background.",
            advice="Send a mask, white on black or black on white, or an object in front of a plain background.",
        )
    height, width = mask.shape
    box = (columns[0] / width, rows[0] / height, (columns[-1] + 1) / width, (rows[-1] + 1) / height)
    share = float(mask.mean())
    if share > _LARGEST_SHARE:
        raise SilhouetteError(
            f"{name} is covered whole, so that it has no outline.", advice="Leave a margin around the object."
        )
    left, top, right, bottom = (round(float(end), 4) for end in box)
    return SilhouettePicture(mask, PictureSummary(kind, *size, (left, top, right, bottom), round(share, 4)))


def _decoded(data: bytes, name: str) -> tuple[Image.Image, str, tuple[int, int]]:
    """Return a picture, reduced and upright, its format, and its own size."""
    advice = "Send a PNG, a JPEG or a WebP."
    try:
        file = Image.open(io.BytesIO(data), formats=_FORMATS)
    except _FAILURES as error:
        raise SilhouetteError(f"{name} cannot be read as a PNG, JPEG or WebP.", advice=advice) from error
    if file.width * file.height > _MAX_PIXELS:
        raise AssetTooLargeError(
            f"{name} has {file.width} x {file.height} pixels; the limit is {_MAX_PIXELS:,} in all.",
            advice=f"Scale it down; {_SIDE} x {_SIDE} are enough.",
        )
    try:
        kind, size = str(file.format).lower(), file.size
        file.draft("RGB", (2 * _SIDE, 2 * _SIDE))
        file.load()
        picture = ImageOps.exif_transpose(file)
        if picture.size == file.size[::-1]:
            size = size[::-1]
        if picture.mode not in ("RGB", "RGBA", "L", "LA"):
            transparent = "transparency" in picture.info or picture.mode in ("PA", "La", "RGBa")
            picture = picture.convert("RGBA" if transparent else "RGB")
        elif "transparency" in picture.info:
            picture = picture.convert("RGBA")
        picture.thumbnail((_SIDE, _SIDE), Image.Resampling.BOX)
    except _FAILURES as error:
        raise SilhouetteError(f"{name} is damaged: {error}.", advice=advice) from error
    return picture, kind, size


def _of_opacity(picture: Image.Image) -> NDArray[np.bool_] | None:
    """Return the mask of opaque pixels; None if none is transparent."""
    if picture.mode not in ("RGBA", "LA"):
        return None
    opacity = np.asarray(picture.getchannel("A"))
    return None if (opacity >= _OPAQUE).all() else np.asarray(opacity >= _OPAQUE)


def _of_colours(picture: Image.Image, name: str) -> NDArray[np.bool_]:
    """Return the mask of pixels that differ from the colour of the border."""
    colours = np.asarray(picture, np.int16)
    width = max(1, round(_BORDER * min(colours.shape[:2])))
    inner = np.zeros(colours.shape[:2], bool)
    inner[width:-width, width:-width] = True
    border = colours[~inner]
    background = np.median(border, axis=0)
    distance = np.abs(colours - background).max(2)
    plain = float((distance[~inner] <= _NOISE).mean())
    if plain < _LEAST_PLAIN:
        raise SilhouetteError(
            f"{name} has no plain background: only {plain:.0%} of its border have one colour.",
            advice="Cut the object out (a transparent background is best), or send a mask.",
        )
    threshold = max(_NOISE, _otsu(np.minimum(distance, 255).astype(np.uint8)))
    mask = Image.fromarray(np.where(distance > threshold, 255, 0).astype(np.uint8))
    # Specks of noise and compression.
    return np.asarray(mask.filter(ImageFilter.MedianFilter(3))) > 0


def _otsu(values: NDArray[np.uint8]) -> int:
    """Return the threshold between two classes of values that maximises the variance between them."""
    counts = np.bincount(values.reshape(-1), minlength=256).astype(np.float64)
    below = counts.cumsum()
    above = below[-1] - below
    total = (counts * np.arange(256)).cumsum()
    with np.errstate(divide="ignore", invalid="ignore"):
        between = below * above * (total / below - (total[-1] - total) / above) ** 2
    return int(np.nanargmax(np.where(np.isfinite(between), between, 0.0)))
