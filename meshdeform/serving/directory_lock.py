"""Allow only one `meshdeform serve` at a time on a data directory."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

from meshdeform.errors import UnavailableError

__all__ = ["DirectoryLock"]

_NAME = "serve.lock"


class DirectoryLock:
    """An exclusive lock on a directory, held by this process and by every child that inherits `fd`.

    A `serve` that starts right after another was killed therefore waits until the last child has exited, instead of
    sharing the record, the port and the queue with it.

    Parameters
    ----------
    directory : Path
        Created if it does not exist.
    patience_s : float
        How long to wait for the children of a `serve` that has exited.

    Raises
    ------
    UnavailableError
        Another `serve` runs on the directory, or the directory cannot be written.
    """

    def __init__(self, directory: Path, *, patience_s: float = 40.0) -> None:
        path = directory / _NAME
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self.fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise UnavailableError(
                f"The data directory {directory} cannot be written: {error.strerror}.",
                advice="Make it writable, or choose another with --data-dir.",
            ) from error
        deadline = time.monotonic() + patience_s
        while not self._try():
            holder = self._holder()
            if _alive(holder) or time.monotonic() > deadline:
                os.close(self.fd)
                raise UnavailableError(
                    f"Another `meshdeform serve` (process {holder}) runs on {directory}.",
                    advice="Stop it first, or choose another directory with --data-dir.",
                )
            time.sleep(0.05)
        os.ftruncate(self.fd, 0)
        os.pwrite(self.fd, f"{os.getpid()}\n".encode(), 0)

    def close(self) -> None:
        """Release this process's hold on the lock; children that still run keep theirs."""
        os.close(self.fd)

    def _try(self) -> bool:
        try:
            fcntl.flock(self.fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _holder(self) -> int:
        """Return the id of the last process to take the lock, or 0."""
        text = os.pread(self.fd, 32, 0).strip()
        return int(text) if text.isdigit() else 0


def _alive(pid: int) -> bool:
    if pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
