"""`result.usdz`: the stage and its textures in one package, laid out as AR viewers ask (USDZ specification, Pixar)."""

from __future__ import annotations

import importlib.util
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshdeform.assets.scene import SceneView
from meshdeform.errors import DependencyError

__all__ = ["Usdz", "require_usd", "write_usdz"]

_WRITTEN = (1980, 1, 2, 0, 0, 0, 0, 2, -1)  # in local time; ZIP's calendar begins a day before
_INSTEAD = {
    "animations": "the nodes as they stand in the file",
    "skins": "the bind pose, deformed",
    "morph targets": "the base shape",
}


@dataclass(frozen=True)
class Usdz:
    """A package, and what it does not hold.

    Attributes
    ----------
    data : bytes
    meshes : int
        How many there are in it.
    left_out : list of dict
        `what` of the asset is not in it, its `count`, and, where there is one, what stands there `instead`.
    """

    data: bytes
    meshes: int
    left_out: list[dict[str, Any]]


def require_usd() -> None:
    """Refuse early where usd-core is not installed.

    Raises
    ------
    DependencyError
    """
    if importlib.util.find_spec("pxr") is None:
        raise DependencyError(
            "output.usd asks for result.usdz, and usd-core is not installed where the job runs.",
            advice='Install it there: pip install "meshdeform[usd]". Or leave output.usd out.',
        )


def write_usdz(scene: SceneView) -> Usdz:
    """Write a scene as USDZ.

    Parameters
    ----------
    scene : SceneView

    Returns
    -------
    The same bytes for the same scene: +Y is up, a unit is a metre.

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
    """Put the layer first and the textures after it, uncompressed and each at a multiple of 64 bytes.

    `UsdUtils.CreateNewUsdzPackage` would write the layer anew to rename the textures, with the time of day.
    """
    from pxr import Sdf

    written = time.mktime(_WRITTEN)
    writer = Sdf.ZipFileWriter.CreateNew(str(package))
    for name in (layer.name, *textures):
        os.utime(layer.parent / name, (written, written))
        if not writer.AddFile(str(layer.parent / name), name):
            raise OSError(f"usd-core did not take {name} into the USDZ package; its own message is in the log.")
    if not writer.Save():
        raise OSError("usd-core did not write the USDZ package; its own message is in the log.")
