"""Write an asset's images as files: PNG and JPEG unchanged, WebP as PNG, since USDZ does not allow WebP."""

from __future__ import annotations

import io
from pathlib import Path

from PIL import Image as Picture

from meshdeform.assets.materials import Image
from meshdeform.assets.scene import SceneView
from meshdeform.errors import AssetError

__all__ = ["Textures"]

_MAX_PIXELS = 8192 * 8192


class Textures:
    """Writes each requested image once.

    Parameters
    ----------
    scene : SceneView
    folder : Path
        The layer's folder. Textures go to `textures/` in it.
    """

    def __init__(self, scene: SceneView, folder: Path) -> None:
        self._scene, self._folder = scene, folder
        self._paths: dict[int, str | None] = {}
        self.written: list[str] = []
        self.left_out = 0

    def path(self, image: int) -> str | None:
        """Return an image's path relative to the layer, or None if it is broken or USDZ does not allow its format."""
        if image not in self._paths:
            self._paths[image] = self._write(image)
        return self._paths[image]

    def _write(self, number: int) -> str | None:
        try:
            image = self._scene.image(number)
        except AssetError:  # the deformation did not need the image: leave it out instead of failing
            image = Image(b"", "")
        data, kind = (_png(image), "png") if image.kind == "webp" else (image.data, image.kind)
        if not data or not kind:
            self.left_out += 1
            return None
        (self._folder / "textures").mkdir(exist_ok=True)
        path = f"textures/image{number}.{kind}"
        (self._folder / path).write_bytes(data)
        self.written.append(path)
        return path


def _png(image: Image) -> bytes:
    """Return a WebP image as a PNG, or b"" if it is broken or too large."""
    try:
        with Picture.open(io.BytesIO(image.data), formats=["WEBP"]) as picture:
            if picture.width * picture.height > _MAX_PIXELS:
                return b""
            written = io.BytesIO()
            picture.save(written, "PNG")
            return written.getvalue()
    except (OSError, ValueError, SyntaxError, Picture.DecompressionBombError, Picture.DecompressionBombWarning):
        return b""
