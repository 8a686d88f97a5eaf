"""Read a 3D asset losslessly and write it back with a new shape. All handling of glTF is here.

Names are imported on first use, so that the API process can inspect an upload without numpy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshdeform.assets.asset import Asset, load_asset
    from meshdeform.assets.build import Primitive, build_glb
    from meshdeform.assets.check import check_asset_subprocess
    from meshdeform.assets.inspect import AssetSummary, inspect_asset
    from meshdeform.assets.limits import Limits
    from meshdeform.assets.surface import Surface

__all__ = [
    "Asset",
    "AssetSummary",
    "Limits",
    "Primitive",
    "Surface",
    "build_glb",
    "check_asset_subprocess",
    "inspect_asset",
    "load_asset",
]

_HOMES = {
    "Asset": "asset",
    "AssetSummary": "inspect",
    "Limits": "limits",
    "Primitive": "build",
    "Surface": "surface",
    "build_glb": "build",
    "check_asset_subprocess": "check",
    "inspect_asset": "inspect",
    "load_asset": "asset",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
