"""Keep the memory of a process with many threads small where the C library is glibc."""

from __future__ import annotations

import ctypes
import os
from contextlib import suppress

__all__ = ["HEAPS", "limit_heaps"]

HEAPS = 2
_M_ARENA_MAX = -8
"""`mallopt`'s name of the limit, from glibc's malloc.h."""


def limit_heaps() -> None:
    """Let all threads of this process share two heaps, unless the environment sets MALLOC_ARENA_MAX.

    glibc makes eight for each core, and each keeps what its threads have freed. Call this before there are threads.
    """
    if "MALLOC_ARENA_MAX" not in os.environ:
        with suppress(OSError, AttributeError, TypeError):  # macOS, musl, Windows
            ctypes.CDLL(None).mallopt(_M_ARENA_MAX, HEAPS)
