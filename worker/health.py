"""``python -m worker.health``: exit with code 0 if a supervisor runs on this host. For health checks of containers.

A supervisor holds a lock on a file while it runs. The kernel releases the lock when the process ends, however it ends.
"""

from __future__ import annotations

import fcntl
import logging
import os
import re
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from meshdeform.settings import Settings

__all__ = ["main", "sign_of_life"]

_log = logging.getLogger(__name__)


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
