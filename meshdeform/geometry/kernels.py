"""Compile loops over numbers to machine code, when the first of them is called: numba takes long to import."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import update_wrapper
from typing import Any, TypeVar

_Function = TypeVar("_Function", bound=Callable[..., Any])


class _Kernel:
    """A function that is compiled when it is first called."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._compiled: Callable[..., Any] | None = None
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        return (self._compiled or self.compiled)(*arguments)

    @property
    def compiled(self) -> Callable[..., Any]:
        """The compiled function, which other processes have compiled if they could."""
        if self._compiled is None:
            import numba

            self._compiled = numba.njit(cache=True, nogil=True)(self._function)
            # numba knows compiled functions only, so they replace those that the function may call by name.
            names = self._function.__globals__
            for name, value in list(names.items()):
                if isinstance(value, _Kernel):
                    names[name] = value.compiled
        return self._compiled


def kernel(function: _Function) -> _Function:
    """Compile a function once for all processes; while it runs, other threads run too."""
    lazy: Any = _Kernel(function)
    made: _Function = lazy
    return made


class Worth:
    """Says whether work is worth the time that numba takes to import, where numpy can do it as well.

    `enough`: from how much work on in all, of this process, it is. Once numba is imported, all is.
    """

    def __init__(self, enough: int) -> None:
        self._enough, self._done = enough, 0

    def __call__(self, work: int) -> bool:
        """Return it for the next work."""
        self._done += work
        return self._done > self._enough or "numba" in sys.modules
