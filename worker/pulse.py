"""The interface between a supervisor and its worker process: a name, an exit code, a grace period, and a pulse.

The pulse shows the supervisor that its worker makes progress: a counter in shared memory, incremented at each step and
phase. The lease does not show it, because a thread renews it however long a step hangs. A write to shared memory never
blocks, whatever the supervisor does.
"""

from __future__ import annotations

import os
import secrets
import socket
import struct
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

__all__ = ["OUT_OF_MEMORY", "PULSE", "STOP_GRACE_S", "WORKER_ID", "Pulse", "PulseMonitor", "new_worker_id"]

WORKER_ID = "MESHDEFORM_WORKER_ID"
"""The environment variable with the worker's id, set by the supervisor only. Not a setting."""

OUT_OF_MEMORY = 75
"""The exit code of a process whose device ran out of memory; it is restarted at once. EX_TEMPFAIL of sysexits.h."""

STOP_GRACE_S = 30.0
"""Seconds that a worker has after SIGTERM to finish its step and write a checkpoint."""

PULSE = "MESHDEFORM_PULSE"
"""The environment variable with the descriptor of the pulse, set by the supervisor only. Not a setting."""

_STATE = struct.Struct("<QQ")  # beats, and 1 while the worker is busy
_LONGEST_LOOK_S = 1.0


def new_worker_id() -> str:
    """Return a name that is unique among all processes, past and future.

    The host's name is for people who read the record. Host and process id are not enough: containers may share both.
    """
    return f"{socket.gethostname()[:200]}:{secrets.token_hex(8)}"


class Pulse:
    """The worker's end of the pulse. It starts as busy, because the process is loading.

    Parameters
    ----------
    descriptor : int, optional
        Descriptor of the shared memory; None without a supervisor.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor, self._beats = descriptor, 0

    @classmethod
    def of_environment(cls) -> Pulse:
        """Return the pulse that the supervisor passed to this process."""
        given = os.environ.get(PULSE)
        return cls(int(given) if given else None)

    def beat(self) -> None:
        """Signal that something was done and the worker is still busy."""
        self._write(busy=True)

    def rest(self) -> None:
        """Signal that the worker is idle, so that silence has no meaning."""
        self._write(busy=False)

    def _write(self, *, busy: bool) -> None:
        self._beats += 1
        if self._descriptor is not None:
            os.pwrite(self._descriptor, _STATE.pack(self._beats, busy), 0)


class PulseMonitor:
    """The supervisor's end of the pulse, for one worker process.

    Parameters
    ----------
    clock : callable
        Returns seconds.

    Attributes
    ----------
    descriptor : int
        Descriptor of the shared memory, which the worker process must inherit under this number.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.descriptor = _shared_memory()
        os.pwrite(self.descriptor, _STATE.pack(0, True), 0)
        self._clock, self._looked = clock, clock()
        self._beats, self._silent_s = 0, 0.0

    def silent_s(self) -> float:
        """Return the seconds since a busy worker last made progress; 0 for an idle one. Must be called often."""
        # Time in which this process itself was stopped does not count: its worker was probably stopped too.
        now = self._clock()
        passed, self._looked = min(now - self._looked, _LONGEST_LOOK_S), now
        beats, busy = _STATE.unpack(os.pread(self.descriptor, _STATE.size, 0))
        self._silent_s = self._silent_s + passed if busy and beats == self._beats else 0.0
        self._beats = beats
        return self._silent_s

    @property
    def loading(self) -> bool:
        """Whether the process has not sent any beat yet."""
        return self._beats == 0

    def close(self) -> None:
        """Close the shared memory here; the worker process keeps its own descriptor."""
        os.close(self.descriptor)


def _shared_memory() -> int:
    if hasattr(os, "memfd_create"):
        return os.memfd_create("meshdeform-pulse")
    descriptor, path = tempfile.mkstemp(prefix="meshdeform-pulse-")
    Path(path).unlink()
    return descriptor
