"""The program of a child: read what is given from standard input, run one task, and answer on standard output."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
from contextlib import suppress

from meshdeform.children.protocol import OUT_OF_MEMORY, Bounds, answer_of
from meshdeform.children.tasks import loaded

__all__ = ["main"]


def main() -> int:
    """Return the exit status: 0 if the task was answered, be it with an error."""
    answers = os.dup(sys.stdout.fileno())
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what a decoder may print
    _end_with_reader(answers)
    asked = json.loads(sys.stdin.buffer.read())
    Bounds(**asked["bounds"]).apply()
    try:
        answer = json.dumps(answer_of(lambda: loaded(asked["task"])(asked["given"])))
    except MemoryError:
        return OUT_OF_MEMORY
    if sys.platform == "linux":
        signal.signal(signal.SIGIO, signal.SIG_IGN)  # a pipe that is read sends it, too
    with os.fdopen(answers, "w") as file:
        file.write(answer)
    return 0


def _end_with_reader(pipe: int) -> None:
    """Let the kernel end this process when nobody can read its answer any more: its parent has ended.

    A pipe of which the other end was closed says so by `SIGIO`, which ends a process that does not expect it. Where a
    system has no such thing, the bound on the processor's time ends it.
    """
    if sys.platform != "linux":
        return
    import fcntl

    with suppress(OSError):
        fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    closed = select.poll()
    closed.register(pipe, 0)
    if closed.poll(0):  # before the kernel was asked
        os._exit(1)
