"""Meshdeform: deform 3D assets by text, and give the asset back whole.

This package imports nothing heavy: ``import meshdeform`` needs neither torch nor a web framework. The client of the
HTTP service and the errors are here, and loaded when they are first named. The numerical core lives in modules that
are imported by name, e.g. ``meshdeform.deformation.loop``.
"""

from __future__ import annotations

TYPE_CHECKING = False  # as type checkers read it; `typing` would cost more than all the rest of this module
if TYPE_CHECKING:
    from typing import Any

    from meshdeform.client import AsyncClient, AsyncResult, Client, Result, WaitTimeoutError
    from meshdeform.errors import (
        AssetEmptyError,
        AssetError,
        AssetExternalError,
        AssetFormatError,
        AssetNotFiniteError,
        AssetTooLargeError,
        AssetTruncatedError,
        AssetUnsupportedError,
        CheckpointError,
        ChecksumError,
        ConflictError,
        DependencyError,
        DeviceMemoryError,
        ForbiddenError,
        IdempotencyBusyError,
        IdempotencyMismatchError,
        LimitError,
        MeshdeformError,
        MethodNotAllowedError,
        ModelError,
        NotFoundError,
        NumericalError,
        ParameterError,
        PromptError,
        RangeError,
        RequestError,
        RequestTimeoutError,
        StaleAttemptError,
        TooManyJobsError,
        UnauthorizedError,
        UnavailableError,
        VocabularyError,
        WebhookAddressError,
        WorkerLostError,
    )

__all__ = [
    "AssetEmptyError",
    "AssetError",
    "AssetExternalError",
    "AssetFormatError",
    "AssetNotFiniteError",
    "AssetTooLargeError",
    "AssetTruncatedError",
    "AssetUnsupportedError",
    "AsyncClient",
    "AsyncResult",
    "CheckpointError",
    "ChecksumError",
    "Client",
    "ConflictError",
    "DependencyError",
    "DeviceMemoryError",
    "ForbiddenError",
    "IdempotencyBusyError",
    "IdempotencyMismatchError",
    "LimitError",
    "MeshdeformError",
    "MethodNotAllowedError",
    "ModelError",
    "NotFoundError",
    "NumericalError",
    "ParameterError",
    "PromptError",
    "RangeError",
    "RequestError",
    "RequestTimeoutError",
    "Result",
    "StaleAttemptError",
    "TooManyJobsError",
    "UnauthorizedError",
    "UnavailableError",
    "VocabularyError",
    "WaitTimeoutError",
    "WebhookAddressError",
    "WorkerLostError",
    "__version__",
]

__version__ = "0.1.0"

_OF_THE_CLIENT = frozenset({"AsyncClient", "AsyncResult", "Client", "Result", "WaitTimeoutError"})


def __getattr__(name: str) -> Any:
    # Loaded when they are named: whoever imports the numerical core needs no httpx.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    found = getattr(import_module("meshdeform.client" if name in _OF_THE_CLIENT else "meshdeform.errors"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
