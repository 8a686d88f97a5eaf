"""What a program has loaded is not searched for garbage as it ends, and what was to be done at its end is done."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import atexit, gc, sys, weakref
from meshdeform.support.memory import skip_last_collections

class Loop:
    def __init__(self):
        self.itself = self
        weakref.finalize(self, print, "finalised")

loop = Loop()
atexit.register(print, "at exit")
gc.callbacks.append(lambda phase, info: phase == "stop" and print("collected", info["collected"]))
del loop
skip_last_collections()
sys.exit(3)
"""


def test_the_last_collections_find_nothing_and_the_end_is_as_before() -> None:
    ended = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (3, "")
    lines = ended.stdout.splitlines()
    assert {"at exit", "finalised"} <= set(lines)
    assert not [line for line in lines if line.startswith("collected") and line != "collected 0"]
