"""``python -m worker.health``: exit code 0 while a supervisor lives on this host. For the health checks of containers.

A supervisor holds a lock on a file for as long as it lives. The kernel takes the lock away when the process ends,
however it ends.
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
    """Hold the lock that the health check looks for. A folder that cannot be written only gets a warning."""
    try:
        settings.data_dir.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(_path(settings), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        _log.warning("health checks will not see this worker: %s", error)
        yield
        return
    try:
        # Shared, so that several supervisors can hold it.
        fcntl.flock(descriptor, fcntl.LOCK_SH)
        yield
    finally:
        os.close(descriptor)


def main() -> int:
    """Look for a supervisor, print what is wrong, and return the exit code."""
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
