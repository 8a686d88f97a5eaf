"""Upgrade the record's schema, in a process of its own for those that stay.

python -m meshdeform.record.upgrade      upgrade the record whose URL is on standard input
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import sqlalchemy as sa

from meshdeform.errors import UnavailableError

__all__ = ["main", "upgrade", "upgrade_apart"]

_MIGRATIONS = Path(__file__).parent / "migrations"


def upgrade(connection: sa.Connection) -> None:
    """Upgrade the record to the schema of this version, within the connection's transaction.

    Raises
    ------
    UnavailableError
        A newer Meshdeform has upgraded it before.
    """
    # Import Alembic only if there is something to do, to save time and memory.
    import alembic.command
    import alembic.config
    import alembic.util

    config = alembic.config.Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(_MIGRATIONS).replace("%", "%%"))
    try:
        alembic.command.upgrade(config, "head")
    except alembic.util.CommandError as error:
        raise UnavailableError(
            "The record has the schema of a newer Meshdeform.", advice="Install that version or a newer one."
        ) from error


def upgrade_apart(url: str) -> None:
    """Let a child process upgrade the record, so that Alembic (10 MB) does not stay in this one. Never raises.

    Whoever calls this opens the record afterwards, and meets there what went wrong here.
    """
    # The URL may have a password, which must not be among the arguments.
    command = [sys.executable, "-P", "-m", __name__]
    subprocess.run(command, input=url.encode(), stderr=subprocess.DEVNULL, check=False)


def main() -> None:
    """Open the record, which upgrades it, and close it."""
    from meshdeform.record.database import Database

    Database(sys.stdin.buffer.read().decode(), connections=1).close()


if __name__ == "__main__":
    main()
