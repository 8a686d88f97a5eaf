"""Meshdeform: deform 3D assets by text, and give the asset back whole.

This package imports nothing heavy: ``import meshdeform`` needs neither torch nor a web framework. The client of the
HTTP service and the errors are here, and loaded when they are first named. The numerical core lives in modules that
are imported by name, e.g. ``meshdeform.deformation.loop``.
"""

from __future__ import annotations

__all__ = ["AsyncClient", "AsyncResult", "Client", "Result", "WaitTimeoutError", "__version__"]

TYPE_CHECKING = False  # as type checkers read it; `typing` would cost more than all the rest of this module
if TYPE_CHECKING:
    from typing import Any

    from meshdeform import errors
    from meshdeform.client import AsyncClient, AsyncResult, Client, Result, WaitTimeoutError
    from meshdeform.errors import *  # noqa: F403

    __all__ += errors.__all__

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    # Loaded when they are named: whoever imports the numerical core needs no httpx.
    from importlib import import_module

    if name in __all__:
        found = getattr(import_module("meshdeform.client"), name)
    elif name.endswith("Error") and name in import_module("meshdeform.errors").__all__:
        found = getattr(import_module("meshdeform.errors"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    from meshdeform import errors

    return sorted({*globals(), *__all__, *errors.__all__})
