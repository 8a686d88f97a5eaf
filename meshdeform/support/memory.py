"""Keep Python from searching and freeing what was loaded, and tell glibc how much freed memory to keep.

Standard library only.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

HEAPS = 2
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
"""`mallopt`'s names, from glibc's malloc.h."""
_KEPT = 256 << 20
_LARGEST = 32 << 20
"""Bytes of a block that still comes from a heap; glibc accepts no more."""


@contextmanager
def collection_paused(*, keep: bool = False) -> Iterator[None]:
    """Do not look for garbage inside the block, where much is made and hardly anything dropped.

    To import torch and numba makes a million objects, and a thousand collections search them for garbage that is not
    there (docs/performance.md). Outside of programs of our own nothing is paused. With `keep`, what exists at the end
    of the block, such as modules, is also left out of all later collections.
    """
    if not gc.isenabled():  # whoever turned it off, or an outer block, decides
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if keep:
            gc.freeze()
        gc.enable()


@contextmanager
def quick_end() -> Iterator[None]:
    """Let the process end without freeing memory; enter it first in a program of our own that ends by `sys.exit`.

    Python searches for garbage and frees all that was ever loaded, which takes longer with torch than everything else
    that ends. Functions registered for the end since then (`atexit`, `weakref.finalize`) run as before.
    """
    codes: list[int] = []

    def end() -> None:
        if codes and not hasattr(sys, "last_value"):  # nor was there an error later on, which nobody caught
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(codes[0])

    atexit.register(end)  # the first one is called last
    try:
        yield
    except SystemExit as ended:
        if ended.code is None or isinstance(ended.code, int):
            codes.append(ended.code or 0)
        raise


def limit_heaps() -> None:
    """Let all threads of this process share two heaps, unless the environment sets MALLOC_ARENA_MAX.

    glibc makes eight for each core, and each keeps what its threads have freed. Call this before there are threads.
    """
    _set(_M_ARENA_MAX, HEAPS, "MALLOC_ARENA_MAX")


def keep_freed_memory() -> None:
    """Keep up to 256 MB that were freed, for a process that computes; the environment's own settings win.

    torch frees most of its tensors within a step. glibc returns them to the system, which has to clear every page of
    the next step's tensors.
    """
    _set(_M_MMAP_THRESHOLD, _LARGEST, "MALLOC_MMAP_THRESHOLD_")
    _set(_M_TRIM_THRESHOLD, _KEPT, "MALLOC_TRIM_THRESHOLD_")


def return_freed_memory() -> None:
    """Return the pages to the system on which nothing lies any more; this takes less than a millisecond.

    By itself glibc returns only what is free at the end of a heap, where something of every burst of requests stays.
    """
    with suppress(OSError, AttributeError, TypeError):  # macOS, musl, Windows
        _library().malloc_trim(0)


def _set(option: int, value: int, variable: str) -> None:
    if variable not in os.environ:
        with suppress(OSError, AttributeError, TypeError):  # macOS, musl, Windows
            _library().mallopt(option, value)


def _library() -> Any:
    import ctypes  # which commands that compute nothing do without

    return ctypes.CDLL(None)
