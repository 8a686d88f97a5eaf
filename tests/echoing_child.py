"""A task that returns what it is given, or ends as it says."""

from __future__ import annotations

import os
from typing import Any


def echo(given: dict[str, Any]) -> dict[str, Any]:
    """Print something that is no answer, and return what is given, unless it says how to end."""
    print('{"found": "nothing"}', flush=True)
    if given.get("do") == "exit":
        os._exit(7)
    if given.get("do") == "memory":
        raise MemoryError
    return given
