"""Tell the C library, where it is glibc, how much freed memory a process should keep."""

from __future__ import annotations

import ctypes
import os
from contextlib import suppress

__all__ = ["HEAPS", "keep_freed_memory", "limit_heaps", "return_freed_memory"]

HEAPS = 2
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
"""`mallopt`'s names, from glibc's malloc.h."""
_KEPT = 256 << 20
_LARGEST = 32 << 20
"""Bytes of a block that still comes from a heap; glibc accepts no more."""


def limit_heaps() -> None:
    """Let all threads of this process share two heaps, unless the environment sets MALLOC_ARENA_MAX.

    glibc makes eight for each core, and each keeps what its threads have freed. Call this before there are threads.
    """
    _set(_M_ARENA_MAX, HEAPS, "MALLOC_ARENA_MAX")


def keep_freed_memory() -> None:
    """Keep up to 256 MB that were freed, for a process that computes; the environment's own settings win.

    torch frees most of its tensors within a step. glibc returns them to the system, which has to clear every page of
    the next step's tensors (docs/performance.md).
    """
    _set(_M_MMAP_THRESHOLD, _LARGEST, "MALLOC_MMAP_THRESHOLD_")
    _set(_M_TRIM_THRESHOLD, _KEPT, "MALLOC_TRIM_THRESHOLD_")


def return_freed_memory() -> None:
    """Return the pages to the system on which nothing lies any more; this takes less than a millisecond.

    By itself glibc returns only what is free at the end of a heap, where something of every burst of requests stays.
    """
    with suppress(OSError, AttributeError, TypeError):  # macOS, musl, Windows
        ctypes.CDLL(None).malloc_trim(0)


def _set(option: int, value: int, variable: str) -> None:
    if variable not in os.environ:
        with suppress(OSError, AttributeError, TypeError):  # macOS, musl, Windows
            ctypes.CDLL(None).mallopt(option, value)
