"""What a supervisor and its worker process share: a name, an exit code, a time to stop, and a pulse.

The pulse is how the supervisor sees that its worker moves: a counter in shared memory, beaten at each step and phase.
The lease cannot tell it, for a thread renews that however long a step hangs. A write to shared memory never waits,
whatever the supervisor does meanwhile.
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
"""The variable that carries it from the supervisor to the process. No setting: nobody else sets it."""

OUT_OF_MEMORY = 75
"""The exit code of a process whose device ran out of memory: it is started again at once. EX_TEMPFAIL of sysexits.h."""

STOP_GRACE_S = 30.0
"""What a worker gets after SIGTERM to finish its step and write a checkpoint."""

PULSE = "MESHDEFORM_PULSE"
"""The variable that carries the descriptor from the supervisor to the process. No setting: nobody else sets it."""

_STATE = struct.Struct("<QQ")  # beats, and 1 while the worker is busy
_LONGEST_LOOK_S = 1.0


def new_worker_id() -> str:
    """Return a name that no other process has or will have.

    The host's name is for whoever reads the record. Host and process id would not do: containers may share both.
    """
    return f"{socket.gethostname()[:200]}:{secrets.token_hex(8)}"


class Pulse:
    """The worker's end. Starts busy: a process that loads has something to do.

    Parameters
    ----------
    descriptor : int, optional
        Of the memory; None where nobody looks.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor, self._beats = descriptor, 0

    @classmethod
    def of_environment(cls) -> Pulse:
        """The pulse that this process was given by its supervisor."""
        given = os.environ.get(PULSE)
        return cls(int(given) if given else None)

    def beat(self) -> None:
        """Something was done, and there is more to do."""
        self._write(busy=True)

    def rest(self) -> None:
        """There is nothing to do: silence is no sign of anything."""
        self._write(busy=False)

    def _write(self, *, busy: bool) -> None:
        self._beats += 1
        if self._descriptor is not None:
            os.pwrite(self._descriptor, _STATE.pack(self._beats, busy), 0)


class PulseMonitor:
    """The supervisor's end, for one life of the worker process.

    Parameters
    ----------
    clock : callable
        Seconds.

    Attributes
    ----------
    descriptor : int
        For the process, which needs it open under this number, and for `close`.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.descriptor = _shared_memory()
        os.pwrite(self.descriptor, _STATE.pack(0, True), 0)
        self._clock, self._looked = clock, clock()
        self._beats, self._silent_s = 0, 0.0

    def silent_s(self) -> float:
        """Seconds that a busy worker has not moved; 0 for one that rests. Call this often."""
        # What counts is the time in which we looked. While this process itself was stopped, so was its worker.
        now = self._clock()
        passed, self._looked = min(now - self._looked, _LONGEST_LOOK_S), now
        beats, busy = _STATE.unpack(os.pread(self.descriptor, _STATE.size, 0))
        self._silent_s = self._silent_s + passed if busy and beats == self._beats else 0.0
        self._beats = beats
        return self._silent_s

    @property
    def loading(self) -> bool:
        """Whether the process has not said anything yet."""
        return self._beats == 0

    def close(self) -> None:
        """Give the memory back; the process keeps its own hold of it."""
        os.close(self.descriptor)


def _shared_memory() -> int:
    if hasattr(os, "memfd_create"):
        return os.memfd_create("meshdeform-pulse")
    descriptor, path = tempfile.mkstemp(prefix="meshdeform-pulse-")
    Path(path).unlink()
    return descriptor
