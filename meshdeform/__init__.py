"""Deform 3D assets by text and preserve everything else in the asset.

``import meshdeform`` is fast and needs neither torch nor a web framework. It exports the client of the HTTP service and
the errors, which are imported on first use. Import the modules of the numerical core by name, for example
``meshdeform.deformation.loop``.
"""

from __future__ import annotations

from meshdeform._version import __version__

__all__ = ["AsyncClient", "AsyncResult", "Client", "Result", "WaitTimeoutError", "__version__"]

TYPE_CHECKING = False  # type checkers treat it as True; importing `typing` would be slower than this whole module
if TYPE_CHECKING:
    from typing import Any

    from meshdeform import errors
    from meshdeform.client import AsyncClient, AsyncResult, Client, Result, WaitTimeoutError
    from meshdeform.errors import *  # noqa: F403

    __all__ += errors.__all__


def __getattr__(name: str) -> Any:
    # Imported on first use, so that the numerical core does not need httpx.
    from importlib import import_module

    if name in __all__:
        attribute = getattr(import_module("meshdeform.client"), name)
    elif name.endswith("Error") and name in import_module("meshdeform.errors").__all__:
        attribute = getattr(import_module("meshdeform.errors"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = attribute
    return attribute


def __dir__() -> list[str]:
    from meshdeform import errors

    return sorted({*globals(), *__all__, *errors.__all__})
