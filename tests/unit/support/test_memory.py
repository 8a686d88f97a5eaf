"""Threads share two of glibc's heaps, and what is freed in a step is there for the next one."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys

import pytest

from meshdeform.support.memory import HEAPS, keep_freed_memory, limit_heaps, return_freed_memory

PROGRAM = """
import ctypes, threading
from meshdeform.support.memory import limit_heaps
if {limited}:
    limit_heaps()
met, library = threading.Barrier(12), ctypes.CDLL(None)
library.malloc.restype = ctypes.c_void_p
def work():
    met.wait()  # all live at once
    library.malloc(ctypes.c_size_t(1000))
    met.wait()
threads = [threading.Thread(target=work) for _ in range(12)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
library.malloc_stats()
"""

STEPS = """
import resource
from meshdeform.support.memory import keep_freed_memory
if {kept}:
    keep_freed_memory()
def step():
    begun = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    tensors = [b"x" * (8 << 20) for _ in range(10)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - begun
step()
print(step())
"""


# Frees 40 MB below a block that stays at the end of the heap, and prints how much of it the process still has, before
# and after it returns what is free.
BURST = """
import os
from meshdeform.support.memory import return_freed_memory
def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
resident()
before = resident()
blocks = [bytes(range(200)) * 100 for _ in range(2000)]
last = blocks[-1]
blocks = None
print(resident() - before)
return_freed_memory()
print(resident() - before)
"""


def heaps(*, limited: bool, **environment: str) -> int:
    """Return the number of heaps of a process of twelve threads."""
    program = PROGRAM.format(limited=limited)
    kept = {name: value for name, value in os.environ.items() if name != "MALLOC_ARENA_MAX"}
    ran = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, env={**kept, **environment}
    )
    return len(re.findall(r"^Arena \d+:", ran.stderr, re.MULTILINE))


def page_faults(*, kept: bool, **environment: str) -> int:
    """Return how many new pages the second of two equal steps of a process needs."""
    usual = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    program = [sys.executable, "-c", STEPS.format(kept=kept)]
    return int(subprocess.run(program, check=True, capture_output=True, text=True, env={**usual, **environment}).stdout)


only_glibc = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc has such heaps")


@only_glibc
def test_threads_share_a_few_heaps_and_return_them_unless_the_environment_says_otherwise() -> None:
    assert heaps(limited=False) > HEAPS
    assert heaps(limited=True) == HEAPS
    assert heaps(limited=True, MALLOC_ARENA_MAX="5") == 5
    usual = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    ran = subprocess.run([sys.executable, "-c", BURST], check=True, capture_output=True, text=True, env=usual)
    kept, left = map(float, ran.stdout.split())
    assert kept > 30
    assert left < 10


@only_glibc
def test_a_step_reuses_the_memory_of_the_step_before_unless_the_environment_says_otherwise() -> None:
    pages = 10 * (8 << 20) // os.sysconf("SC_PAGESIZE")
    assert page_faults(kept=False) > pages // 2
    assert page_faults(kept=True) < pages // 100
    assert page_faults(kept=True, MALLOC_MMAP_THRESHOLD_="1000000") > pages // 2


def test_other_libraries_of_c_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    for error in (OSError, TypeError):

        def missing(_: object, error: type[Exception] = error) -> None:
            raise error

        monkeypatch.setattr("ctypes.CDLL", missing)
        limit_heaps()
        keep_freed_memory()
        return_freed_memory()
    monkeypatch.setattr("ctypes.CDLL", lambda _: object())
    limit_heaps()


# What a program has loaded is not freed as it ends, and what was to be done at its end is done.


ENDING = """
import atexit, sys, threading, weakref
from meshdeform.support.memory import quick_end

class Loaded:
    def __del__(self):
        print("freed")

kept = Loaded()
with quick_end():
    weakref.finalize(kept, print, "finalised")
    atexit.register(print, "at exit")
    threading.Timer(0.05, print, ["of a thread"]).start()
    try:
        sys.exit(3)
    finally:
        {}
"""


def ended(last: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", ENDING.format(last)], capture_output=True, text=True, check=False)


def test_a_program_ends_without_freeing_what_it_loaded_unless_an_error_ends_it() -> None:
    end = ended("pass")
    assert (end.returncode, end.stderr) == (3, "")
    assert sorted(end.stdout.split("\n")) == ["", "at exit", "finalised", "of a thread"]
    end = ended("raise ValueError('lost')")
    assert (end.returncode, end.stderr.splitlines()[-1]) == (1, "ValueError: lost")
    assert "freed" in end.stdout
    assert ended("exec('try: sys.exit(4)\\nfinally: assert 1 == 2')").returncode == 1
