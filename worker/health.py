"""``python -m worker.health``: exit code 0 while this host's supervisor lives. For the health checks of containers."""

from __future__ import annotations

import logging
import re
import socket
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from meshdeform.settings import Settings

__all__ = ["SignOfLife", "main"]

_log = logging.getLogger(__name__)
_EVERY_S = 10.0
_ALIVE_S = 60.0


def _path(settings: Settings) -> Path:
    # Hosts may share the folder; supervisors of one host share the file.
    host = re.sub(r"[^A-Za-z0-9.-]", "_", socket.gethostname())
    return settings.data_dir / f"worker-{host}.alive"


class SignOfLife:
    """A file that the supervisor touches every ten seconds, for the length of a `with` block.

    Parameters
    ----------
    settings : Settings
    """

    def __init__(self, settings: Settings) -> None:
        self._path = _path(settings)
        self._next = 0.0
        self._warned = False

    def __enter__(self) -> Self:
        self.give()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._path.unlink(missing_ok=True)
        except OSError:
            _log.debug("there is no sign of life to take back")

    def give(self) -> None:
        """Touch it, if it is time; call this often."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + _EVERY_S
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._path.touch()
        except OSError as error:
            if not self._warned:
                _log.warning("health checks will not see this worker: %s", error)
            self._warned = True


def main() -> int:
    """Look, say what there is, and return the exit code."""
    path = _path(Settings())
    try:
        age_s = time.time() - path.stat().st_mtime
    except OSError:
        print("no supervisor has run here", file=sys.stderr)
        return 1
    if age_s > _ALIVE_S:
        print(f"the supervisor is silent for {age_s:.0f} s", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
