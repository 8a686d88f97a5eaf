"""The name that a worker process claims jobs under, chosen by its supervisor so that both know it."""

from __future__ import annotations

import secrets
import socket

__all__ = ["WORKER_ID", "new_worker_id"]

WORKER_ID = "MESHDEFORM_WORKER_ID"
"""The variable that carries it from the supervisor to the process. No setting: nobody else sets it."""


def new_worker_id() -> str:
    """Return a name that no other process has or will have.

    The host's name is for whoever reads the record. Host and process id would not do: containers may share both.
    """
    return f"{socket.gethostname()[:200]}:{secrets.token_hex(8)}"
