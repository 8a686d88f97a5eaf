"""Answer Ctrl-C during long work: between two steps, and within a call of compiled code that does not return."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from meshdeform.cli.exits import ExitCode

__all__ = ["ctrl_c_between_steps", "second_ctrl_c_ends"]

_GRACE_S = 2.0
"""Seconds that the second Ctrl-C has to end the work by an exception."""
_OVER = b"\0"


@contextmanager
def ctrl_c_between_steps() -> Iterator[Any]:
    """Defer the first Ctrl-C to the end of the step, when the state is consistent; the second acts at once."""
    interrupted = False

    def handle(_number: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        if interrupted:
            raise KeyboardInterrupt
        interrupted = True

    with second_ctrl_c_ends():
        previous = signal.signal(signal.SIGINT, handle)
        try:
            yield lambda: interrupted
        finally:
            signal.signal(signal.SIGINT, previous)


@contextmanager
def second_ctrl_c_ends() -> Iterator[None]:
    """End the process if a second Ctrl-C does not end the block: Python's handlers wait until compiled code returns.

    The interpreter writes the number of each signal to a pipe at once, and a thread reads it.
    """
    read, write = os.pipe()
    os.set_blocking(write, False)
    over = threading.Event()

    def watch() -> None:
        count = 0
        while (number := os.read(read, 1)) != _OVER:
            count += number[0] == signal.SIGINT
            if count > 1 and not over.wait(_GRACE_S):
                os.write(2, b"Interrupted.\n")
                os._exit(ExitCode.INTERRUPTED)

    watcher = threading.Thread(target=watch, name="Ctrl-C", daemon=True)
    watcher.start()
    previous = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(previous)
        over.set()
        os.write(write, _OVER)
        watcher.join()
        os.close(read)
        os.close(write)
