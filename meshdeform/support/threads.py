"""How many threads to compute with, and how they wait for each other.

torch's threads meet after every operation. libgomp, its thread library on Linux, makes a thread that arrives first spin
for milliseconds before it sleeps. Where other programs use the cores too, that time is taken from the very thread that
is waited for: on two busy cores a step took ten times the CPU time that it needs on one thread.
"""

from __future__ import annotations

import math
import os
from contextlib import suppress
from pathlib import Path

__all__ = ["default_threads", "limit_spinning"]

_SPINS = "10000"
"""Rounds that a thread spins before it sleeps; libgomp's own number is 300,000. Fewer rounds are cheaper still on a
busy machine, but cost time on a quiet one (docs/performance.md)."""
_CGROUP = Path("/sys/fs/cgroup")


def limit_spinning() -> None:
    """Make torch's threads sleep soon when they wait, unless the environment says how they should wait.

    Has an effect only before torch is imported, in this process and in those that it starts.
    """
    if "OMP_WAIT_POLICY" not in os.environ:
        os.environ.setdefault("GOMP_SPINCOUNT", _SPINS)


def default_threads(cgroup: Path = _CGROUP) -> int:
    """Return the number of threads where none is set.

    ``OMP_NUM_THREADS`` if it is a number; otherwise the cores that this process may use, by its affinity and by the
    limit of its container, whichever is less.

    Parameters
    ----------
    cgroup : Path
        Where the control groups are mounted.
    """
    asked = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    if asked.isdecimal() and int(asked):
        return int(asked)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(cores, _container_cores(cgroup)))


def _container_cores(cgroup: Path) -> int:
    """Return the cores that a container's CPU limit amounts to, rounded up; a large number without a limit."""
    with suppress(OSError, ValueError, IndexError, ZeroDivisionError):
        quota, period = (cgroup / "cpu.max").read_text().split()[:2]  # "max 100000" without a limit
        return math.ceil(int(quota) / int(period))
    with suppress(OSError, ValueError, ZeroDivisionError):
        quota_us = int((cgroup / "cpu/cpu.cfs_quota_us").read_text())  # version 1: -1 without a limit
        period_us = int((cgroup / "cpu/cpu.cfs_period_us").read_text())
        if quota_us > 0:
            return math.ceil(quota_us / period_us)
    return 1 << 30
