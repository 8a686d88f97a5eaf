"""Write an asset as USDZ with Pixar's usd-core. Imported only if a job requests it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshdeform.assets.usd.package import Usdz, require_usd, write_usdz

__all__ = ["Usdz", "require_usd", "write_usdz"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("meshdeform.assets.usd.package"), name)
