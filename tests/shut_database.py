"""A PostgreSQL database that an operator shuts: to writes, or to the login of its user."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import sqlalchemy as sa

__all__ = ["WAYS", "ShutDatabase", "database_to_shut"]

WAYS = {
    "read-only": ("SET default_transaction_read_only = on", "RESET default_transaction_read_only"),
    "no login": ("NOLOGIN", "LOGIN"),
    "no connections": ("ALLOW_CONNECTIONS false", "ALLOW_CONNECTIONS true"),
}
"""What is said to the database or its user to shut it, and to open it again."""


class ShutDatabase:
    """A database with a user of its own, who logs in at `url`."""

    def __init__(self, admin: sa.Engine, url: sa.URL, user: str) -> None:
        self._admin, self._name, self._user = admin, url.database, user
        self.url = url.set(drivername="postgresql", username=user).render_as_string(hide_password=False)

    def shut(self, way: str) -> None:
        """Shut it, and end every session, as an operator does."""
        self._say(way, WAYS[way][0])

    def open(self, way: str) -> None:
        """Open it again. Sessions of a read-only server would stay so."""
        self._say(way, WAYS[way][1])

    def _say(self, way: str, change: str) -> None:
        who = f"ROLE {self._user}" if way == "no login" else f"DATABASE {self._name}"
        ended = "SELECT pg_terminate_backend(pid, 30000) FROM pg_stat_activity WHERE datname = :name"
        with self._admin.connect() as connection:
            connection.execute(sa.text(f"ALTER {who} {change}"))
            connection.execute(sa.text(ended), {"name": self._name})


@contextmanager
def database_to_shut(url: str) -> Iterator[ShutDatabase]:
    """Give an empty database, which another fixture makes and drops, a user that no other test has."""
    parsed = sa.make_url(url)
    user = f"user_of_{parsed.database}"
    admin = sa.create_engine(parsed.set(database="postgres"), isolation_level="AUTOCOMMIT", poolclass=sa.NullPool)
    with admin.connect() as connection:
        connection.execute(sa.text(f"CREATE ROLE {user} LOGIN SUPERUSER"))
    database = ShutDatabase(admin, parsed, user)
    try:
        yield database
    finally:
        for way in WAYS:
            database.open(way)
        with admin.connect() as connection:
            connection.execute(sa.text(f"DROP DATABASE {parsed.database} WITH (FORCE)"))
            connection.execute(sa.text(f"DROP ROLE {user}"))
            connection.execute(sa.text(f"CREATE DATABASE {parsed.database}"))
        admin.dispose()
