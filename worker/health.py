"""Signs of life: of a supervisor for health checks, and of its worker process for the supervisor.

``python -m worker.health`` exits with code 0 if a supervisor runs on this host, for health checks of containers. A
supervisor holds a lock on a file while it runs. The kernel releases the lock when the process ends, however it ends.

The pulse shows the supervisor that its worker makes progress: a counter in shared memory, incremented at each step and
phase. The lease does not show it, because a thread renews it however long a step hangs. A write to shared memory never
blocks, whatever the supervisor does.
"""

from __future__ import annotations

import fcntl
import logging
import os
import re
import secrets
import socket
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from meshdeform.settings import Settings

_log = logging.getLogger(__name__)

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
    """The worker's end of the pulse, in shared memory if there is a supervisor. At the start it is busy: it loads."""

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor, self._beats = descriptor, 0

    @classmethod
    def of_environment(cls) -> Pulse:
        """Return the pulse that the supervisor passed to this process."""
        pulse = os.environ.get(PULSE)
        return cls(int(pulse) if pulse else None)

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

    `descriptor` is that of the shared memory, which the worker process must inherit under this number.
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


def _path(settings: Settings) -> Path:
    # Hosts may share the folder; supervisors of one host share the file.
    host = re.sub(r"[^A-Za-z0-9.-]", "_", socket.gethostname())
    return settings.data_dir / f"worker-{host}.lock"


@contextmanager
def sign_of_life(settings: Settings) -> Iterator[None]:
    """Hold the lock that the health check tests. A folder that cannot be written only causes a warning."""
    try:
        settings.data_dir.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(_path(settings), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        _log.warning("health checks will not find this worker: %s", error)
        yield
        return
    try:
        # Shared, so that several supervisors can hold it.
        fcntl.flock(descriptor, fcntl.LOCK_SH)
        yield
    finally:
        os.close(descriptor)


def main() -> int:
    """Test for a supervisor, print why there is none, and return the exit code."""
    try:
        descriptor = os.open(_path(Settings()), os.O_RDWR)
    except OSError:
        print("no supervisor has run here", file=sys.stderr)
        return 1
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return 0
    finally:
        os.close(descriptor)
    print("the supervisor has ended", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
