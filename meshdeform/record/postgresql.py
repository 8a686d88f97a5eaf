"""PostgreSQL's driver pg8000, with the one thing that it leaves to its callers: errors of the socket.

A server that resets the connection, in the middle of an answer or while it is connected to, is a `ConnectionResetError`
for callers of pg8000. SQLAlchemy takes that for a mistake of ours: it neither drops the connection nor asks again.
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
"""The driver's name in a URL, for SQLAlchemy."""


class Pg8000Dialect(PGDialect_pg8000):
    """Errors of the socket are `InterfaceError` with the words by which the dialect knows a lost connection."""

    supports_statement_cache = True

    @contextmanager
    def network(self) -> Iterator[None]:
        """Say in the driver's words that the network broke."""
        try:
            yield
        except (OSError, struct.error) as error:
            raise self.loaded_dbapi.InterfaceError(f"network error: {error}") from error

    def connect(self, *arguments: Any, **options: Any) -> Any:
        """Connect."""
        with self.network():
            return super().connect(*arguments, **options)

    def set_isolation_level(self, dbapi_connection: Any, level: Any) -> None:
        """Turn autocommit on or off, which costs no trip to the server; every other level but the default does."""
        if level in ("AUTOCOMMIT", getattr(self, "default_isolation_level", None)):
            dbapi_connection.autocommit = level == "AUTOCOMMIT"
            return
        with self.network():
            super().set_isolation_level(dbapi_connection, level)  # type: ignore[no-untyped-call]

    def do_ping(self, dbapi_connection: Any) -> bool:
        """Ask for a sign of life, in one trip to the server: outside of a transaction."""
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
        """Commit, where there is a transaction."""
        if dbapi_connection.autocommit:
            return
        with self.network():
            super().do_commit(dbapi_connection)  # type: ignore[no-untyped-call]

    def do_rollback(self, dbapi_connection: Any) -> None:
        """Roll back."""
        with self.network():
            super().do_rollback(dbapi_connection)  # type: ignore[no-untyped-call]

    def do_execute(self, cursor: Any, statement: Any, parameters: Any, context: Any = None) -> None:
        """Execute a statement; pg8000 reads its whole answer here."""
        with self.network():
            super().do_execute(cursor, statement, parameters, context)  # type: ignore[no-untyped-call]

    def do_executemany(self, cursor: Any, statement: Any, parameters: Any, context: Any = None) -> None:
        """Execute a statement for many parameters."""
        with self.network():
            super().do_executemany(cursor, statement, parameters, context)  # type: ignore[no-untyped-call]

    def do_execute_no_params(self, cursor: Any, statement: Any, context: Any = None) -> None:
        """Execute a statement without parameters."""
        with self.network():
            super().do_execute_no_params(cursor, statement, context)  # type: ignore[no-untyped-call]

    def do_close(self, dbapi_connection: Any) -> None:
        """Close, also where the other end is gone and hears no goodbye: the pool would log that as an error."""
        with suppress(self.loaded_dbapi.InterfaceError, OSError):
            super().do_close(dbapi_connection)  # type: ignore[no-untyped-call]


sa.dialects.registry.register(DRIVER.replace("+", "."), __name__, "Pg8000Dialect")
