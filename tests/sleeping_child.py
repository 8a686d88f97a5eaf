"""A child process that does not end by itself."""

from __future__ import annotations

import time


def main() -> int:
    """Sleep."""
    time.sleep(600)
    return 1
