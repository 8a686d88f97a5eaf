"""Compile loops over numbers to machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(function: _Function) -> _Function:
    """Compile a function once for all processes; while it runs, other threads run too."""
    compiled: _Function = numba.njit(cache=True, nogil=True)(function)
    return compiled
