"""SQLAlchemy's dialect for PostgreSQL's driver pg8000, extended to handle errors of the socket.

If the server resets the connection, pg8000 raises `ConnectionResetError`. SQLAlchemy does not recognise that as a lost
connection: it neither drops the connection nor retries.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects.postgresql.pg8000 import PGDialect_pg8000

__all__ = ["DRIVER", "Pg8000Dialect"]

DRIVER = "postgresql+meshdeform"
"""The driver's name in SQLAlchemy's URLs."""


class Pg8000Dialect(PGDialect_pg8000):
    """A dialect that turns errors of the socket into `InterfaceError`s that it recognises as a disconnect."""

    supports_statement_cache = True

    @contextmanager
    def network(self) -> Iterator[None]:
        """Convert errors of the socket to the driver's `InterfaceError`."""
        try:
            yield
        except (OSError, struct.error) as error:
            raise self.loaded_dbapi.InterfaceError(f"network error: {error}") from error

    def connect(self, *arguments: Any, **options: Any) -> Any:
        """Connect."""
        with self.network():
            return super().connect(*arguments, **options)

    def set_isolation_level(self, dbapi_connection: Any, level: Any) -> None:
        """Set the isolation level. Autocommit and the default level need no round trip to the server."""
        if level in ("AUTOCOMMIT", getattr(self, "default_isolation_level", None)):
            dbapi_connection.autocommit = level == "AUTOCOMMIT"
            return
        with self.network():
            super().set_isolation_level(dbapi_connection, level)  # type: ignore[no-untyped-call]

    def do_ping(self, dbapi_connection: Any) -> bool:
        """Ping the server in one round trip, outside a transaction."""
        before, dbapi_connection.autocommit = dbapi_connection.autocommit, True
        try:
            with self.network():
                return bool(super().do_ping(dbapi_connection))
        finally:
            dbapi_connection.autocommit = before

    def do_begin(self, dbapi_connection: Any) -> None:
        """Begin a transaction."""
        with self.network():
            super().do_begin(dbapi_connection)  # type: ignore[no-untyped-call]

    def do_commit(self, dbapi_connection: Any) -> None:
        """Commit, unless in autocommit mode."""
        if dbapi_connection.autocommit:
            return
        with self.network():
            super().do_commit(dbapi_connection)  # type: ignore[no-untyped-call]

    def do_rollback(self, dbapi_connection: Any) -> None:
        """Roll back."""
        with self.network():
            super().do_rollback(dbapi_connection)  # type: ignore[no-untyped-call]

    def do_execute(self, cursor: Any, statement: Any, parameters: Any, context: Any = None) -> None:
        """Execute a statement and read its whole result."""
        with self.network():
            super().do_execute(cursor, statement, parameters, context)  # type: ignore[no-untyped-call]

    def do_executemany(self, cursor: Any, statement: Any, parameters: Any, context: Any = None) -> None:
        """Execute a statement with several sets of parameters."""
        with self.network():
            super().do_executemany(cursor, statement, parameters, context)  # type: ignore[no-untyped-call]

    def do_execute_no_params(self, cursor: Any, statement: Any, context: Any = None) -> None:
        """Execute a statement without parameters."""
        with self.network():
            super().do_execute_no_params(cursor, statement, context)  # type: ignore[no-untyped-call]

    def do_close(self, dbapi_connection: Any) -> None:
        """Close the connection; ignore errors if the server is gone, which the pool would log."""
        with suppress(self.loaded_dbapi.InterfaceError, OSError):
            super().do_close(dbapi_connection)  # type: ignore[no-untyped-call]


sa.dialects.registry.register(DRIVER.replace("+", "."), __name__, "Pg8000Dialect")
