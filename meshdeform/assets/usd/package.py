"""Pack a stage and its textures as USDZ, as the specification of the format (Pixar) requires."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from meshdeform.assets.scene import Scene
from meshdeform.errors import AssetEmptyError

_WRITTEN = (1980, 1, 2, 0, 0, 0, 0, 2, -1)  # in local time; ZIP's calendar begins one day earlier


def write_usdz(scene: Scene) -> tuple[bytes, int]:
    """Write a scene as USDZ, +Y up and in metres; needs usd-core. The same scene gives the same bytes.

    Returns the package and the number of its triangles. Raises AssetEmptyError: nothing is shown.
    """
    from meshdeform.assets.usd.stage import StageWriter

    with tempfile.TemporaryDirectory(prefix="meshdeform-usd-") as folder:
        layer, package = Path(folder, "result.usdc"), Path(folder, "result.usdz")
        writer = StageWriter(scene, layer)
        writer.write()
        if not writer.triangles:
            raise AssetEmptyError("The asset has no triangles that a USDZ could hold.")
        _pack(layer, writer.textures, package)
        return package.read_bytes(), writer.triangles


def _pack(layer: Path, textures: list[str], package: Path) -> None:
    """Pack the layer and then the textures, uncompressed and each at a multiple of 64 bytes.

    `UsdUtils.CreateNewUsdzPackage` is not used: it rewrites the layer to rename the textures, and stores the time.
    """
    from pxr import Sdf

    written = time.mktime(_WRITTEN)
    writer = Sdf.ZipFileWriter.CreateNew(str(package))
    for name in (layer.name, *textures):
        os.utime(layer.parent / name, (written, written))
        if not writer.AddFile(str(layer.parent / name), name):
            raise OSError(f"usd-core could not add {name} to the USDZ package; its own message is in the log.")
    if not writer.Save():
        raise OSError("usd-core could not write the USDZ package; its own message is in the log.")
