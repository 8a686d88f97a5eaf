"""What processes answer that are kept for tests."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from typing import Any

from meshdeform.children.protocol import StoppedError
from meshdeform.errors import PartNotFoundError

_seen: list[str] = []


def answer(task: dict[str, Any], stopped: Callable[[], bool]) -> Any:
    """Do what a task says, and return what there is to know of this process."""
    _seen.append(task.get("name", ""))
    if task["do"] == "refuse":
        raise PartNotFoundError("There is no trunk.", advice="Name another.", parts=["legs"])
    if task["do"] == "die":
        os._exit(3)
    if task["do"] == "wait":
        while not stopped():
            time.sleep(0.01)
        raise StoppedError
    if task["do"] == "linger":
        time.sleep(0.3)
    if task["do"] == "hang":
        while True:
            time.sleep(1)
    return {
        "pid": os.getpid(),
        "seen": _seen,
        "nice": os.nice(0),
        "environment": sorted(os.environ),
        "torch": "torch" in sys.modules,
    }
