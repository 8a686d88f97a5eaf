"""Decode the images of an asset's base colours, within bounds on memory and time.

Files may hold dozens of images of 8192 x 8192 pixels; a picture of the asset needs a thousandth of them. Every image
is reduced as it is decoded, and all of them together fit a budget.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from meshdeform.assets.document import Document
from meshdeform.assets.materials import Image, read_image
from meshdeform.errors import AssetError

__all__ = ["Pictures"]

_MAX_SIDE = 1024
_MAX_TEXELS = 1 << 24
"""Of all textures together, after they were reduced: 64 MiB."""
_MAX_DECODED = 8192 * 8192
"""Pixels of one image before it is reduced."""
_MAX_DECODED_TOTAL = 2 * _MAX_DECODED
_UNREADABLE = np.full((1, 1, 4), (150, 150, 150, 255), np.uint8)
_FORMATS = ["PNG", "JPEG", "WEBP"]
_OTHER_KINDS = ((b"\xabKTX 20", "KTX2 texture"), (b"DDS ", "DDS texture"))
_FAILURES = (
    OSError,
    ValueError,
    SyntaxError,
    MemoryError,
    Picture.DecompressionBombError,
    Picture.DecompressionBombWarning,
)


class Pictures:
    """Decodes each image once.

    Parameters
    ----------
    document : Document
    leave_out : callable
        Called with the description of each image that cannot be drawn.
    """

    def __init__(self, document: Document, leave_out: Callable[[str], None]) -> None:
        self._document, self._leave_out = document, leave_out
        self._side = _MAX_SIDE
        self._left = _MAX_DECODED_TOTAL
        self._decoded: dict[tuple[int, bool], NDArray[np.uint8]] = {}

    def plan(self, images: Iterable[int]) -> None:
        """Share the budget among the images that will be asked for."""
        count = max(1, len(set(images)))
        self._side = max(16, min(_MAX_SIDE, int((_MAX_TEXELS / count) ** 0.5)))

    def pixels(self, at: int, *, opaque: bool) -> NDArray[np.uint8]:
        """Return an image as (H, W, 4) uint8 sRGB and alpha, or one grey pixel if it cannot be drawn.

        Parameters
        ----------
        at : int
            Index into the document's images.
        opaque : bool
            Whether to ignore its alpha.
        """
        if (at, opaque) not in self._decoded:
            self._decoded[at, opaque] = self._read(at, opaque=opaque)
        return self._decoded[at, opaque]

    def _read(self, at: int, *, opaque: bool) -> NDArray[np.uint8]:
        try:
            image = read_image(self._document, at)
        except AssetError:
            outside = self._document.root["images"][at].get("uri", "data:")[:5].lower() != "data:"
            self._leave_out("image in another file" if outside else "invalid image")
            return _UNREADABLE
        if not image.kind:
            self._leave_out(next((what for magic, what in _OTHER_KINDS if image.data.startswith(magic)), "other image"))
            return _UNREADABLE
        try:
            return self._decode(image, opaque=opaque)
        except _FAILURES:
            self._leave_out(f"unreadable {image.kind} image")
            return _UNREADABLE

    def _decode(self, image: Image, *, opaque: bool) -> NDArray[np.uint8]:
        with Picture.open(io.BytesIO(image.data), formats=_FORMATS) as picture:
            picture.draft("RGB", (self._side, self._side))  # JPEG only: decodes at a half, a quarter or an eighth
            pixels = picture.width * picture.height
            if pixels > min(_MAX_DECODED, self._left):
                raise ValueError("too many pixels")
            self._left -= pixels
            picture.load()
            mode = "RGB" if opaque else "RGBA"
            # Reduced before the conversion where possible, which would need a second large picture.
            small: Picture.Image = picture
            if picture.mode not in ("RGB", "RGBA", "L"):
                small = picture.convert("RGBA")
            if opaque and small.mode == "RGBA":
                small = small.convert("RGB")  # else reducing would darken what is transparent
            factor = max(small.size) / self._side
            if factor >= 2:
                small = small.reduce(int(factor))
            if max(small.size) > self._side:
                small = small.resize(
                    tuple(max(1, round(side * self._side / max(small.size))) for side in small.size),  # type: ignore[arg-type]
                    Picture.Resampling.BOX,
                )
            return np.asarray(small.convert(mode).convert("RGBA"))
