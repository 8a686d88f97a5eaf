"""Read PostgreSQL's codes of errors from those of its driver."""

from __future__ import annotations

READ_ONLY_SERVER = "25006"
"""The code of a write to a standby, or to a primary that an operator has set to read-only."""


def sql_state(error: BaseException | None) -> str:
    """Return the code of an error of the driver; empty if it has none."""
    said = error.args[0] if error is not None and error.args else None
    return str(said.get("C", "")) if isinstance(said, dict) else ""
