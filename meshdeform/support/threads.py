"""How many threads to compute with, how they wait for each other, and how they share work.

torch's threads meet after every operation. libgomp, its thread library on Linux, makes a thread that arrives first spin
for milliseconds before it sleeps. Where other programs use the cores too, that time is taken from the very thread that
is waited for: on two busy cores a step took ten times the CPU time that it needs on one thread.

Standard library only.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

_SPINS = "10000"
"""Rounds that a thread spins before it sleeps; libgomp's own number is 300,000. Fewer rounds are cheaper still on a
busy machine, but cost time on a quiet one (docs/performance.md)."""
_CGROUP = Path("/sys/fs/cgroup")
_chosen = 0
_sharing = threading.local()
_pools: dict[tuple[int, int], ThreadPoolExecutor] = {}
"""By process, because a forked child has none of the threads, and by the number of threads."""


def limit_waiting() -> None:
    """Make torch's threads sleep soon when they wait, and numpy's matrices take one, unless the environment says else.

    Has an effect only before torch and numpy are imported, in this process and in those that it starts. The matrices of
    a fit are small, and numpy's threads spin as well: on two busy cores a fit of 1,920 faces took 25 s of CPU time with
    two threads, and 5 s with one.
    """
    if "OMP_WAIT_POLICY" not in os.environ:
        os.environ.setdefault("GOMP_SPINCOUNT", _SPINS)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def default_threads(cgroup: Path = _CGROUP) -> int:
    """Return the number of threads where none is set.

    ``OMP_NUM_THREADS`` if it is a number; otherwise the cores that this process may use, by its affinity and by the
    limit of its container, whichever is less. `cgroup` is where the control groups are mounted.
    """
    setting = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    if setting.isdecimal() and int(setting):
        return int(setting)
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


def choose_threads(count: int) -> None:
    """Let `in_ranges` use this many threads from now on, in the whole process."""
    global _chosen
    _chosen = count


def usable_threads() -> int:
    """Return the number of threads that was chosen, or else `default_threads`."""
    if not _chosen:
        choose_threads(default_threads())
    return _chosen


def in_ranges(work: Callable[[int, int], T], count: int) -> list[T]:
    """Call ``work(begin, end)`` for consecutive ranges of ``range(count)``, side by side, and return what they return.

    Worth it for work of a tenth of a millisecond or more that releases the interpreter's lock. The calling thread takes
    the first range. With one thread (`choose_threads`), or inside of such work, it takes everything. `work`: called
    with ranges that cover ``range(count)``, in order; which ranges these are must not change the result.
    """
    ranges = 1 if getattr(_sharing, "already", False) else max(1, min(usable_threads(), count))
    bounds = [count * at // ranges for at in range(ranges + 1)]
    if ranges == 1:
        return [work(0, count)]

    def share(begin: int, end: int) -> T:
        _sharing.already = True
        try:
            return work(begin, end)
        finally:
            _sharing.already = False

    key = (os.getpid(), ranges - 1)
    pool = _pools.get(key) or _pools.setdefault(key, ThreadPoolExecutor(ranges - 1, "meshdeform"))
    others = [pool.submit(share, begin, end) for begin, end in pairwise(bounds[1:])]
    try:
        first = share(bounds[0], bounds[1])
    finally:
        # Also after an error: others must not go on writing into what the caller no longer holds.
        results = [other.result() for other in others]
    return [first, *results]


def side_by_side(*works: Callable[[], T]) -> list[T]:
    """Call all works at once, or one after the other with one thread (`choose_threads`); return what they return."""
    if usable_threads() == 1:
        return [work() for work in works]
    with ThreadPoolExecutor(len(works) - 1, "meshdeform") as pool:
        others = [pool.submit(work) for work in works[1:]]
        return [works[0](), *(other.result() for other in others)]
