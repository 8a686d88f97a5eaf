"""What a supervisor and its worker process agree on: the name to claim jobs under, an exit code, a time to stop."""

from __future__ import annotations

import secrets
import socket

__all__ = ["OUT_OF_MEMORY", "STOP_GRACE_S", "WORKER_ID", "new_worker_id"]

WORKER_ID = "MESHDEFORM_WORKER_ID"
"""The variable that carries it from the supervisor to the process. No setting: nobody else sets it."""

OUT_OF_MEMORY = 75
"""The exit code of a process whose device ran out of memory: it is started again at once. EX_TEMPFAIL of sysexits.h."""

STOP_GRACE_S = 30.0
"""What a worker gets after SIGTERM to finish its step and write a checkpoint."""


def new_worker_id() -> str:
    """Return a name that no other process has or will have.

    The host's name is for whoever reads the record. Host and process id would not do: containers may share both.
    """
    return f"{socket.gethostname()[:200]}:{secrets.token_hex(8)}"
