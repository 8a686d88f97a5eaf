"""SQLAlchemy's dialect for pg8000, with bounded transactions and with errors of the network as lost connections.

pg8000 sends a statement in three messages and awaits an answer after each. Outside a transaction, a pooler that shares
connections between transactions (PgBouncer with `pool_mode = transaction`) may give each message another connection to
the server, which does not know the statement. So every statement, a query too, runs within a transaction. Nothing is
set for the rest of a session.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa
from sqlalchemy.dialects.postgresql.pg8000 import PGDialect_pg8000

from meshdeform.record.schema import READ_ONLY_SERVER, sql_state

_PAUSE_S = 1.0
"""Seconds for which nobody tries to connect to a server that did not answer."""

if TYPE_CHECKING:
    from meshdeform.record.database import DatabasePatience

DRIVER = "postgresql+meshdeform"
"""The driver's name in SQLAlchemy's URLs."""


class Dialect(PGDialect_pg8000):
    """A dialect that begins transactions itself and recognises lost connections.

    `idle_s`: seconds after which the server ends a session that pauses within a transaction. A process that is stopped
    or cut off there holds locks needed for the recovery of its job; our transactions never pause by themselves.
    `patience`: how long to wait for the server. After one that could not be connected to, nobody else tries for a
    moment: all who wait for a connection would wait one after the other.
    """

    supports_statement_cache = True
    idle_s = 10.0
    patience: DatabasePatience | None = None
    _away_until = 0.0

    @contextmanager
    def network(self) -> Iterator[None]:
        """Convert errors of the socket, some of which pg8000 lets through, to its `InterfaceError`."""
        try:
            yield
        except OSError as error:
            raise self.loaded_dbapi.InterfaceError(f"network error: {error}") from error

    def is_disconnect(self, error: Any, connection: Any, cursor: Any) -> bool:
        """Return whether the pool's connections are lost. Those to a standby are: another server may be the primary."""
        lost: bool = super().is_disconnect(error, connection, cursor)  # type: ignore[no-untyped-call]
        return lost or sql_state(error) == READ_ONLY_SERVER

    def connect(self, *arguments: Any, **options: Any) -> Any:
        """Connect. pg8000 begins no transactions: `do_begin` does, in one message with their limit."""
        if time.monotonic() < self._away_until:
            raise self.loaded_dbapi.InterfaceError("network error: the server did not answer a moment ago")
        began = time.monotonic()
        try:
            with self.network():
                connection = super().connect(*arguments, **options)
        except self.loaded_dbapi.InterfaceError:
            if self.patience is not None and time.monotonic() >= began + 0.9 * self.patience.connect_s:
                self._away_until = time.monotonic() + _PAUSE_S
            raise
        if self.patience is not None:
            connection._usock.settimeout(self.patience.statement_s)
        connection.autocommit = True
        return connection

    def do_ping(self, dbapi_connection: Any) -> bool:
        """Ask the server whether the connection is alive."""
        if self.patience is None:
            with self.network():
                return bool(super().do_ping(dbapi_connection))
        dbapi_connection._usock.settimeout(self.patience.connect_s)
        with self.network():
            answers = bool(super().do_ping(dbapi_connection))
        dbapi_connection._usock.settimeout(self.patience.statement_s)
        return answers

    def do_begin(self, dbapi_connection: Any) -> None:
        """Begin a transaction, which the server ends if it pauses."""
        limit = f"SET LOCAL idle_in_transaction_session_timeout = '{self.idle_s:g}s'"
        with self.network():
            dbapi_connection.cursor().execute(f"BEGIN; {limit}")

    def do_commit(self, dbapi_connection: Any) -> None:
        """Commit, in one message: pg8000's own `commit` takes three."""
        with self.network():
            dbapi_connection.cursor().execute("COMMIT")

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

    def do_close(self, dbapi_connection: Any) -> None:
        """Close the connection; ignore errors if the server is gone, which the pool would log."""
        with suppress(self.loaded_dbapi.InterfaceError, OSError):
            super().do_close(dbapi_connection)  # type: ignore[no-untyped-call]


sa.dialects.registry.register(DRIVER.replace("+", "."), __name__, "Dialect")
