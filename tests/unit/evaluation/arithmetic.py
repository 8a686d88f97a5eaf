"""Work for the benchmark's processes that costs nothing to load."""

from __future__ import annotations

import os
from collections.abc import Callable


def squares() -> Callable[[int], int]:
    """Work that squares, and dies of 13."""

    def work(number: int) -> int:
        if number == 13:
            os._exit(7)
        return number * number

    return work


def broken() -> Callable[[int], int]:
    """Work that cannot start."""
    raise RuntimeError("no such model")
