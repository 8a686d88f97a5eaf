"""Wait for what something else does."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

DEADLINE_S = 240.0
T = TypeVar("T")


def until(look: Callable[[], T], what: str = "it comes to be so") -> T:
    """Return the first true value, or fail saying what did not happen."""
    deadline = time.monotonic() + DEADLINE_S
    while not (result := look()):
        assert time.monotonic() < deadline, f"not in time: {what}"
        time.sleep(0.01)
    return result
