"""The record's database: SQLite on one machine, PostgreSQL for several, with the same code for both.

Rows are inserted by statements that are built once: SQLAlchemy takes longer to build an insert of forty values, and to
find that it has compiled the same one before, than PostgreSQL to execute it.
"""

from __future__ import annotations

import logging
import os
import sqlite3
import ssl
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import sqlalchemy as sa
import sqlalchemy.exc
from sqlalchemy import event

from meshdeform.errors import DependencyError, RecordVersionError, UnavailableError
from meshdeform.record.columns import UtcDateTime
from meshdeform.record.schema import HEAD, READ_ONLY_SERVER, compatible, sql_state

_log = logging.getLogger(__name__)

RECORD_FILE = "meshdeform.sqlite"
"""The name of the record in a data folder, where nothing else is kept for others."""

_MIGRATIONS = Path(__file__).parent / "migrations"
MAX_CONNECTIONS = 15
"""Connections of an API process to PostgreSQL at most; docs/scaling.md has the sum."""
_KEPT_OPEN = 5
_MIGRATION_LOCK = 0x6D657368  # an arbitrary number, unlikely to be used by another program
_READ_ONLY = "meshdeform_read_only"
_REFUSED = ("28", "3D", "55000")
"""PostgreSQL's codes and classes if it refuses the login, or the database is not there or takes no connections: for
example while it is being restored."""
_AWAY = (READ_ONLY_SERVER, "25P03", "25P04", *_REFUSED, "08", "40", "53", "57", "58")
"""PostgreSQL's codes and classes of temporary errors. Beside those above: a transaction that lasted too long,
connection, rollback (deadlock), resources, operator, system."""
_Statement = TypeVar("_Statement")
_CLOCK = sa.func.statement_timestamp(type_=sa.DateTime(timezone=True))
_NOW = sa.type_coerce(_CLOCK, UtcDateTime)
_LOCK = sa.select(sa.func.pg_advisory_xact_lock(sa.func.hashtext(sa.bindparam("what", type_=sa.String))))
_Shape = tuple[tuple[sa.Table, tuple[tuple[str, Any], ...]], ...]


@dataclass(frozen=True)
class DatabasePatience:
    """Seconds to wait for a database that does not answer: to connect, for a statement, and for a connection.

    A connection that has rested is asked for as long as one is waited for, and then replaced: that is the one retry.
    """

    connect_s: float
    statement_s: float
    pool_s: float


PATIENT = DatabasePatience(30.0, 30.0, 30.0)
"""Of workers and of tasks that nobody waits for."""

HASTY = DatabasePatience(1.5, 4.0, 3.5)
"""Of requests, which are answered within five seconds."""


class Database:
    """Transactions, the clock, and the schema.

    `url`: an SQLAlchemy URL. `postgresql://` and `postgres://` use the driver pg8000; `?sslmode=` is supported.
    `connections`: maximum number of connections to PostgreSQL. Up to five stay open; with 0, none stays open after
    `let_go`. `upgrade_elsewhere`: upgrade an older schema in a process of its own, which costs half a second once and
    saves 10 MB from then on. `patience`: how long to wait for it. Raises UnavailableError: the database does not
    answer. Raises RecordVersionError: a newer Meshdeform has taken away what this one needs.
    """

    def __init__(
        self,
        url: str,
        connections: int = MAX_CONNECTIONS,
        *,
        upgrade_elsewhere: bool = False,
        patience: DatabasePatience = PATIENT,
    ) -> None:
        self._engine = make_engine(url, connections, patience)
        self._lets_go = connections == 0
        self._statements: dict[Callable[[Database], Any], Any] = {}
        self.is_sqlite = self._engine.dialect.name == "sqlite"
        try:
            if self.is_sqlite:
                _make_private(Path(self._engine.url.database or ""))
            self._migrate(url, elsewhere=upgrade_elsewhere)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close every connection."""
        self._engine.dispose()

    def let_go(self) -> None:
        """Close the unused connections of a process that seldom needs any (`connections` = 0)."""
        if self._lets_go:
            self._engine.dispose()

    @contextmanager
    def read(self) -> Iterator[sa.Connection]:
        """Open a transaction of queries. On SQLite they see one snapshot; on PostgreSQL each has its own."""
        with _answers(), self._engine.connect() as connection:
            connection = connection.execution_options(**{_READ_ONLY: True})
            with connection.begin():
                yield connection

    @contextmanager
    def write(self) -> Iterator[sa.Connection]:
        """Open a transaction; on SQLite it holds the write lock from its first statement on."""
        with _answers(), self._engine.begin() as connection:
            yield connection

    def now(self, later_s: float = 0.0) -> Any:
        """Return the current time, or a time so many seconds later, by the clock that all processes share.

        With PostgreSQL this is the server's clock, so that hosts with different clocks agree on whether a lease has
        expired. It is constant within a statement; otherwise comparisons could not use an index.
        """
        if self.is_sqlite:
            return datetime.now(UTC) + timedelta(seconds=later_s)
        if not later_s:
            return _NOW
        return sa.type_coerce(_CLOCK + sa.literal(timedelta(seconds=later_s), sa.Interval()), UtcDateTime)

    def seconds(self, start: sa.ColumnElement[Any], end: Any) -> sa.ColumnElement[float]:
        """Return the expression for the seconds between two times; 0 if one is unknown, or the clock was set back."""
        if self.is_sqlite:
            end = sa.literal(end, UtcDateTime()) if isinstance(end, datetime) else end
            between: Any = (sa.func.julianday(end) - sa.func.julianday(start)) * 86_400.0
        else:
            between = sa.cast(sa.extract("epoch", end - start), sa.Double)
        return sa.case((between > 0.0, between), else_=0.0)

    def clock(self) -> datetime:
        """Return the current time by the clock of `now`, as a value."""
        if self.is_sqlite:
            return datetime.now(UTC)
        with self.read() as connection:
            instant: datetime = connection.execute(sa.select(self.now())).scalar_one()
        return instant

    def prepared(self, build: Callable[[Database], _Statement]) -> _Statement:
        """Return a statement that is built once for PostgreSQL, where `now` is an expression, and anew for SQLite."""
        if self.is_sqlite:
            return build(self)
        statement: _Statement | None = self._statements.get(build)
        if statement is None:
            statement = self._statements[build] = build(self)
        return statement

    def serialise(self, connection: sa.Connection, what: str) -> None:
        """Let transactions that name the same thing follow each other, such as two that would both find room for one.

        The lock ends with the transaction. On SQLite transactions that write follow each other anyway.
        """
        if not self.is_sqlite:
            connection.execute(_LOCK, {"what": what})

    def upsert(self, table: sa.Table) -> Any:
        """Return an `INSERT` that supports `ON CONFLICT`: SQLAlchemy has one for each database."""
        if self.is_sqlite:
            from sqlalchemy.dialects import sqlite

            return sqlite.insert(table)
        from sqlalchemy.dialects import postgresql

        return postgresql.insert(table)

    def _migrate(self, url: str, *, elsewhere: bool) -> None:
        with self.read() as connection:
            # Usually. Many processes that start at once must not wait for each other's lock.
            if compatible(_version(connection)):
                return
        if elsewhere:
            _upgrade_apart(url)
        # DDL is transactional in both databases.
        if self.is_sqlite:
            with self.write() as connection:
                _upgrade(connection)
            return
        # An index of many rows takes as long as it takes.
        patient = make_engine(url, connections=1, patience=None)
        try:
            with _answers(), patient.begin() as connection:
                # The lock ends with the transaction.
                connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_MIGRATION_LOCK)))
                _upgrade(connection)
        finally:
            patient.dispose()


def make_engine(url: str, connections: int = MAX_CONNECTIONS, patience: DatabasePatience | None = PATIENT) -> sa.Engine:
    """Return the engine of a record, with its driver, time limits and TLS. Neither connects nor migrates.

    Without patience, there is no limit to how long anything on PostgreSQL takes. Raises DependencyError: the URL is
    invalid, names a database in memory, or its driver is not installed.
    """
    try:
        parsed = sa.make_url(url)
    except sqlalchemy.exc.ArgumentError as error:
        raise DependencyError(
            "MESHDEFORM_DATABASE_URL is no database URL.",
            advice="Write sqlite:////path/to/file or postgresql://user:password@host/database.",
        ) from error
    ours = parsed.drivername in ("postgresql", "postgres", "postgresql+pg8000")
    if ours:
        from meshdeform.record.postgresql import DRIVER

        parsed = parsed.set(drivername=DRIVER)
    if parsed.get_backend_name() == "sqlite":
        return _sqlite_engine(parsed, patience or PATIENT)
    arguments: dict[str, Any] = {}
    if ours:
        arguments["timeout"] = patience and patience.connect_s
        if mode := parsed.query.get("sslmode"):
            parsed = parsed.difference_update_query(["sslmode"])
            if context := _ssl_context(str(mode)):
                arguments["ssl_context"] = context
    try:
        engine = sa.create_engine(
            parsed,
            connect_args=arguments,
            pool_pre_ping=True,
            **_pool(connections),
            **({"pool_timeout": patience.pool_s} if patience else {}),
        )
    except (ModuleNotFoundError, sqlalchemy.exc.NoSuchModuleError) as error:
        raise DependencyError(
            f"The database driver {parsed.drivername} is not installed.",
            advice="Use postgresql:// (the driver pg8000 comes with Meshdeform) or sqlite://.",
        ) from error
    if ours and patience is not None:
        engine.dialect.patience = patience  # type: ignore[attr-defined]
    return engine


def _pool(connections: int) -> dict[str, Any]:
    """Return the options of SQLAlchemy's pool for so many connections."""
    connections = max(connections, 1)
    kept = min(connections, _KEPT_OPEN)
    return {"pool_size": kept, "max_overflow": connections - kept}


def _ssl_context(mode: str) -> ssl.SSLContext | None:
    """Return the TLS context equivalent to libpq's `sslmode`; None for no TLS."""
    if mode in ("disable", "allow", "prefer"):
        return None
    context = ssl.create_default_context()
    if mode != "verify-full":
        context.check_hostname = False
    if mode == "require":
        context.verify_mode = ssl.CERT_NONE
    return context


def _sqlite_engine(url: sa.URL, patience: DatabasePatience) -> sa.Engine:
    if not url.database or url.database == ":memory:":
        raise DependencyError(
            "A record in memory is lost with its process.", advice="Name a file: sqlite:////path/to/meshdeform.sqlite."
        )
    Path(url.database).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    arguments = {"timeout": patience.statement_s, "check_same_thread": False}
    engine = sa.create_engine(url, connect_args=arguments, pool_timeout=patience.pool_s)
    event.listen(engine, "connect", partial(_prepare_sqlite, patience))
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _make_private(path: Path) -> None:
    """Create the file of a record for its user only, and restrict an existing one: it has prompts, secrets and keys."""
    try:
        # Never open an existing one: closing it would release the locks that SQLite holds on it in this process.
        with suppress(FileExistsError):
            os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
        for file in (path, Path(f"{path}-wal"), Path(f"{path}-shm")):
            if file.exists() and file.stat().st_mode & 0o077:
                file.chmod(0o600)
        folder = path.parent.stat()
        # Only a folder of its own: the record may also be in a home folder, or in one that others need.
        if path.name == RECORD_FILE and folder.st_mode & 0o077 and not folder.st_mode & stat.S_ISVTX:
            path.parent.chmod(0o700)
    except PermissionError as error:
        _log.warning("other users of this machine may be able to read the record: %s", error)
    except OSError as error:
        raise UnavailableError(f"The record cannot be opened: {error.strerror}.") from error


def _prepare_sqlite(patience: DatabasePatience, connection: sqlite3.Connection, _record: Any) -> None:
    # sqlite3 begins transactions too late to take the write lock at once; `_begin_sqlite` begins them.
    connection.isolation_level = None
    deadline = time.monotonic() + patience.statement_s
    while True:
        try:
            connection.execute("PRAGMA journal_mode=WAL")
            break
        except sqlite3.OperationalError:
            # The change to WAL, made once per file, does not wait for other connections by itself.
            if time.monotonic() > deadline:
                raise
            time.sleep(0.01)
    connection.execute("PRAGMA synchronous=FULL")
    connection.execute("PRAGMA foreign_keys=ON")
    # Of its default of 2 MB, each of a process's connections keeps as much as it has ever read or written; what
    # another connection writes makes it void, and the system caches the file anyway.
    connection.execute("PRAGMA cache_size=-512")


def _begin_sqlite(connection: sa.Connection) -> None:
    # Take the write lock at once: a transaction that reads first could not write if another one wrote in between.
    reads = connection.get_execution_options().get(_READ_ONLY, False)
    connection.exec_driver_sql("BEGIN" if reads else "BEGIN IMMEDIATE")


@contextmanager
def _answers() -> Iterator[None]:
    """Raise `UnavailableError` for all errors of drivers that mean that the database is temporarily unavailable."""
    away = (sqlalchemy.exc.OperationalError, sqlalchemy.exc.InterfaceError, sqlalchemy.exc.TimeoutError)
    try:
        yield
    except away as error:
        _log.warning("the record does not answer: %s", error)
        raise UnavailableError("The record does not answer.") from error
    except sqlalchemy.exc.DBAPIError as error:
        state = sql_state(error.orig)
        if not error.connection_invalidated and not state.startswith(_AWAY):
            raise
        _log.warning("the record is temporarily unavailable: %s", error)
        if state == READ_ONLY_SERVER:
            raise UnavailableError("The record is read-only.") from error
        if state.startswith(_REFUSED):
            raise UnavailableError("The record's server refuses this login or database.") from error
        raise UnavailableError("The record is temporarily unavailable.") from error


def _version(connection: sa.Connection) -> str | None:
    if not sa.inspect(connection).has_table("alembic_version"):
        return None
    version: str | None = connection.execute(sa.text("SELECT version_num FROM alembic_version")).scalar()
    return version


def _upgrade(connection: sa.Connection) -> None:
    """Upgrade the record to this version's schema in the connection's transaction, unless it has a newer one."""
    if compatible(_version(connection)):
        return
    # Import Alembic only if there is something to do, to save time and memory.
    import alembic.command
    import alembic.config
    import alembic.util

    config = alembic.config.Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(_MIGRATIONS).replace("%", "%%"))
    try:
        alembic.command.upgrade(config, "head")
    except alembic.util.CommandError as error:
        raise _foreign() from error


def _foreign() -> RecordVersionError:
    return RecordVersionError("The record has the schema of a newer Meshdeform, or of one before the first release.")


def check_version(url: str) -> None:
    """Raise RecordVersionError for a record that this version can neither use nor upgrade; otherwise do nothing.

    Whether it answers is for whoever opens it.
    """
    engine = make_engine(url, connections=1, patience=HASTY)
    try:
        if engine.dialect.name == "sqlite" and not Path(engine.url.database or "").exists():
            return
        with suppress(UnavailableError), _answers(), engine.connect() as connection:
            version = _version(connection)
            known = {path.name[: len(HEAD)] for path in (_MIGRATIONS / "versions").glob("[0-9]*.py")}
            if version is not None and not compatible(version) and version not in known:
                raise _foreign()
    finally:
        engine.dispose()


def _upgrade_apart(url: str) -> None:
    """Let a child process upgrade the record, so that Alembic (10 MB) does not stay in this one. Never raises."""
    # Whoever calls this opens the record afterwards, and meets there what went wrong here.
    # The URL may have a password, which must not be among the arguments.
    command = [sys.executable, "-P", "-m", "meshdeform.record.database"]
    subprocess.run(command, input=url.encode(), stderr=subprocess.DEVNULL, check=False)


class NewRow(NamedTuple):
    """A row to be inserted; values may be SQL expressions."""

    table: sa.Table
    values: Mapping[str, Any]


def insert(connection: sa.Connection, database: Database, row: NewRow, *others: NewRow) -> sa.Row[Any]:
    """Insert a row, and others that may refer to it; return the first as it is then.

    PostgreSQL does so in one statement, which takes one round trip.
    """
    if database.is_sqlite:
        row_written = connection.execute(sa.insert(row.table).values(row.values).returning(row.table)).one()
        for table, values in others:
            connection.execute(sa.insert(table).values(values))
        return row_written
    shape: list[tuple[sa.Table, tuple[tuple[str, Any], ...]]] = []
    parameters: dict[str, Any] = {}
    now, constant = database.now(), True
    for number, (table, values) in enumerate((row, *others)):
        columns: list[tuple[str, Any]] = []
        for name, value in values.items():
            if isinstance(value, sa.ColumnElement):
                columns.append((name, value))
                constant = constant and value is now
            else:
                columns.append((name, None))
                parameters[_parameter(number, name)] = value
        shape.append((table, tuple(columns)))
    statement = _kept(tuple(shape)) if constant else _built(tuple(shape))
    return connection.execute(statement, parameters).one()


def _parameter(number: int, name: str) -> str:
    return f"{name}_of_{number}"


def _built(shape: _Shape) -> Any:
    """Return PostgreSQL's statement for rows of these tables and columns, which have an expression or a parameter."""
    built = []
    for number, (table, columns) in enumerate(shape):
        values = {
            name: sa.bindparam(_parameter(number, name), type_=table.c[name].type) if value is None else value
            for name, value in columns
        }
        built.append(sa.insert(table).values(values))
    first, *others = built
    return first.returning(shape[0][0]).add_cte(*(other.cte(f"also_{n}") for n, other in enumerate(others)))


_kept = lru_cache(maxsize=64)(_built)


if __name__ == "__main__":
    Database(sys.stdin.buffer.read().decode(), connections=1).close()  # to open it upgrades it
