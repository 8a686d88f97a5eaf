"""A task that does not end by itself."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any


def sleep(given: dict[str, Any]) -> None:
    """Say which process this is, in a file, and sleep."""
    if "told" in given:
        told = Path(given["told"])
        told.with_suffix(".part").write_text(str(os.getpid()))
        told.with_suffix(".part").rename(told)
    time.sleep(600)
