"""Write `result.usdz`: the stage and its textures in one package, as the USDZ specification (Pixar) requires."""

from __future__ import annotations

import importlib.util
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshdeform.assets.scene import SceneView
from meshdeform.errors import DependencyError, install_command

__all__ = ["Usdz", "require_usd", "write_usdz"]

_WRITTEN = (1980, 1, 2, 0, 0, 0, 0, 2, -1)  # in local time; ZIP's calendar begins one day earlier
_INSTEAD = {
    "animations": "the nodes as they stand in the file",
    "skins": "the bind pose, deformed",
    "morph targets": "the base shape",
}


@dataclass(frozen=True)
class Usdz:
    """A package, and a list of what it leaves out.

    Attributes
    ----------
    data : bytes
    meshes : int
        Number of meshes in the package.
    left_out : list of dict
        For each omitted feature, `what` it is, its `count` and, if applicable, what is shown `instead`.
    """

    data: bytes
    meshes: int
    left_out: list[dict[str, Any]]


def require_usd() -> None:
    """Check that usd-core is installed, to fail before the job runs.

    Raises
    ------
    DependencyError
    """
    if importlib.util.find_spec("pxr") is None:
        raise DependencyError(
            "output.usd requests result.usdz, but usd-core is not installed where the job runs.",
            advice=f"Install it there: {install_command('usd')}. Or leave output.usd out.",
        )


def write_usdz(scene: SceneView) -> Usdz:
    """Write a scene as USDZ.

    Parameters
    ----------
    scene : SceneView

    Returns
    -------
    A package with +Y up, in metres; the same bytes for the same scene.

    Raises
    ------
    DependencyError
        usd-core is not installed.
    AssetError
        An index or an image's data URI is not valid.
    """
    require_usd()
    from meshdeform.assets.usd.stage import StageWriter

    with tempfile.TemporaryDirectory(prefix="meshdeform-usd-") as folder:
        layer, package = Path(folder, "result.usdc"), Path(folder, "result.usdz")
        writer = StageWriter(scene, layer)
        writer.write()
        _pack(layer, writer.textures, package)
        data = package.read_bytes()
    left_out = [
        {"what": what, "count": count, **({"instead": _INSTEAD[what]} if what in _INSTEAD else {})}
        for what, count in sorted(writer.left_out.items())
    ]
    return Usdz(data, writer.meshes, left_out)


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
