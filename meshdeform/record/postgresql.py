"""SQLAlchemy's dialect for PostgreSQL's driver pg8000: one round trip for each statement, and errors of the socket.

pg8000 sends a statement in two parts and awaits an answer after each. That costs a round trip, and fails behind a
pooler that shares connections between transactions (PgBouncer with `pool_mode = transaction`): outside a transaction,
the second part may reach another server connection, which does not know the statement (26000). Here both parts are one
message, and so is the beginning of a transaction with its first statement. Nothing is set for the rest of a session.

pg8000 walks through every statement character by character, each time, to number its placeholders, which takes longer
than the rest of what it does. Here it does so once for each text.

If the server resets the connection, pg8000 raises `ConnectionResetError`. SQLAlchemy does not recognise that as a lost
connection: it neither drops the connection nor retries.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from typing import Any

import pg8000.dbapi
import sqlalchemy as sa
from pg8000.converters import make_params
from pg8000.core import DESCRIBE, NULL_BYTE, SYNC_MSG, Context
from sqlalchemy.dialects.postgresql.pg8000 import PGDialect_pg8000

from meshdeform.record.sql_states import READ_ONLY_SERVER, sql_state

__all__ = ["DRIVER", "Pg8000Connection", "Pg8000Dialect", "without_time_limit"]

DRIVER = "postgresql+meshdeform"
"""The driver's name in SQLAlchemy's URLs."""

_IDLE_IN_TRANSACTION_S = 10.0
_FRESH_S = 1.0
"""Seconds after an answer for which a connection counts as alive without a ping."""
_PORTAL = b"P"


@lru_cache(maxsize=1024)
def _numbered(statement: str) -> str:
    """Return a statement with `$1`, `$2` and so on in place of `%s`."""
    text, _ = pg8000.dbapi.convert_paramstyle("format", statement, ())
    return str(text)


class _Cursor(pg8000.dbapi.Cursor):  # type: ignore[misc]
    """A cursor that remembers statements whose placeholders it has numbered."""

    def execute(self, operation: str, args: Any = (), stream: Any = None) -> None:
        """Run a statement and read its whole result."""
        if not args or stream is not None or self._input_oids or self._c is None or self._c._sock is None:
            super().execute(operation, args, stream)
            return
        if not self._c._in_transaction and not self._c.autocommit:
            self._c.execute_simple("begin transaction")
        self._context = self._c.execute_unnamed(_numbered(operation), vals=args)
        self._row_iter = None if self._context.rows is None else iter(self._context.rows)


class Pg8000Connection(pg8000.dbapi.Connection):  # type: ignore[misc]
    """A connection that sends a statement, and with the first one of a transaction also its beginning, in one message.

    Attributes
    ----------
    answered_at : float
        Time of the last complete answer, by `time.monotonic`.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._begins = False
        self.answered_at = 0.0
        # A process that is stopped or cut off within a transaction holds locks needed for the recovery of its job. The
        # server ends such sessions; our transactions never pause by themselves.
        self._limit = f"SET LOCAL idle_in_transaction_session_timeout = '{_IDLE_IN_TRANSACTION_S:g}s'"
        super().__init__(*arguments, **options)

    def cursor(self) -> _Cursor:
        """Return a new cursor."""
        return _Cursor(self)

    def execute_simple(self, statement: str) -> Any:
        """Run a statement without parameters; keep the beginning of a transaction for the statement that follows."""
        if statement == "begin transaction":
            self._begins = True
            return None
        if self._begins:
            self._begins = False
            statement = f"BEGIN; {self._limit}; {statement}"
        context = super().execute_simple(statement)
        self.answered_at = time.monotonic()
        return context

    def execute_unnamed(self, statement: str, vals: Any = (), oids: Any = (), stream: Any = None) -> Any:
        """Run a statement in one round trip."""
        if self._begins:
            self._begins = False
            for first in ("BEGIN", self._limit):
                self._send(first, (), ())
        self._send(statement, make_params(self.py_types, vals), oids)
        context = Context(statement, stream=stream)
        self._sock.write(SYNC_MSG)
        self._sock.flush()
        self.handle_messages(context)
        self.answered_at = time.monotonic()
        return context

    def _send(self, statement: str, parameters: Any, oids: Any) -> None:
        self.send_PARSE(NULL_BYTE, statement, oids)
        self.send_BIND(NULL_BYTE, parameters)
        self._send_message(DESCRIBE, _PORTAL + NULL_BYTE)
        self.send_EXECUTE()

    def commit(self) -> None:
        """Commit; a transaction without a statement has not begun."""
        if self._begins:
            self._begins = False
        elif self._in_transaction:
            super().commit()

    def rollback(self) -> None:
        """Roll back; a transaction without a statement has not begun."""
        self._begins = False
        super().rollback()


@contextmanager
def without_time_limit(connection: sa.Connection) -> Iterator[None]:
    """Wait as long as it takes for the answers to the statements of the `with` block, such as an index of many rows."""
    socket = getattr(connection.connection.driver_connection, "_usock", None)
    if socket is None:
        yield
        return
    before = socket.gettimeout()
    socket.settimeout(None)
    try:
        yield
    finally:
        socket.settimeout(before)


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
            return Pg8000Connection(*arguments, **options)

    def set_isolation_level(self, dbapi_connection: Any, level: Any) -> None:
        """Set the isolation level. Autocommit and the default level need no round trip to the server."""
        if level in ("AUTOCOMMIT", getattr(self, "default_isolation_level", None)):
            dbapi_connection.autocommit = level == "AUTOCOMMIT"
            return
        with self.network():
            super().set_isolation_level(dbapi_connection, level)  # type: ignore[no-untyped-call]

    def is_disconnect(self, error: Any, connection: Any, cursor: Any) -> bool:
        """Return whether the pool's connections are lost. Those to a standby are: another server may be the primary."""
        lost: bool = super().is_disconnect(error, connection, cursor)  # type: ignore[no-untyped-call]
        return lost or sql_state(error) == READ_ONLY_SERVER

    def do_ping(self, dbapi_connection: Any) -> bool:
        """Ping the server in one round trip, outside a transaction, unless it has just answered."""
        if time.monotonic() - dbapi_connection.answered_at < _FRESH_S:
            return True
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
