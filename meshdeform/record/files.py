"""Track which stored files are in use, and count what a job keeps; `removal` removes what nothing refers to.

Equal bytes are stored once, and removed with the last job that needs them. A request pins its file before storing it,
and the committed row of its job replaces the pin, so that a file cannot be removed while a request relies on it.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import UnavailableError
from meshdeform.record.database import Database
from meshdeform.record.room import total_size
from meshdeform.record.schema import artifacts, checkpoints, files, job_files, jobs, uploads

__all__ = ["FileLeases", "FileLedger", "measure"]


_PIN_LASTS_S = 3600.0
"""Older pins belong to requests whose process died."""
_REMOVAL_LASTS_S = 900.0
"""Longer than any removal takes; older ones belong to a process that died."""
_BEING_REMOVED = -1
_WAIT_S, _POLL_EVERY_S = 30.0, 0.05
_EXAMINED = 300
"""Number of files that one search for unused ones examines; their number must not slow it down."""


class FileLeases:
    """The pins of one request, released if it ends without a job; created by `FileLedger.leases`."""

    def __init__(self, files: FileLedger) -> None:
        self._files = files
        self._keys: list[str] = []

    def take(self, key: str) -> None:
        """Pin a file, once."""
        if key not in self._keys:
            self._files.pin(key)
            self._keys.append(key)

    def passed_on(self, keys: Collection[str]) -> None:
        """Forget the pins of files that a recorded job now refers to."""
        self._keys = [key for key in self._keys if key not in keys]

    def give_back(self) -> None:
        """Release the remaining pins."""
        if self._keys:
            self._files.unpin(self._keys)


class FileLedger:
    """Pins and references of stored files, by key."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._position = f"assets/{secrets.token_hex(4)}"

    @contextmanager
    def leases(self) -> Iterator[FileLeases]:
        """Pin files while a request creates a job from them."""
        leases = FileLeases(self)
        try:
            yield leases
        finally:
            leases.give_back()

    def pin(self, key: str) -> None:
        """Keep a file for a job that is about to be created. Waits while the file is being removed.

        Raises
        ------
        UnavailableError
            The removal takes too long: the object store is slow or does not answer.
        """
        end = time.monotonic() + _WAIT_S
        while not self._pinned(key):
            if time.monotonic() > end:
                raise UnavailableError("The file is being removed, and the object store does not answer.")
            time.sleep(_POLL_EVERY_S)

    def _pinned(self, key: str) -> bool:
        with self._database.write_once() as connection:
            return connection.execute(self._database.prepared(_pin), {"file": key}).first() is not None

    def unpin(self, keys: Iterable[str], connection: sa.Connection | None = None) -> None:
        """Release pins, within a transaction if given. Files without an entry get one."""
        if connection is None:
            with self._database.write() as own:
                return self.unpin(keys, own)
        for key in keys:
            connection.execute(self._database.prepared(_unpin), {"file": key})
        return None

    def any(self) -> bool:
        """Return whether there is any stored file: then the object store must not be a new one."""
        with self._database.read() as connection:
            return connection.execute(sa.select(files.c.key).limit(1)).first() is not None

    def unused(self) -> list[str]:
        """Return the unused files among the next few hundred; repeated calls go through all files in turn.

        This finds files left behind by dead processes and by expired jobs and uploads. The first position is random, so
        that several processes examine different files.
        """
        with self._database.read() as connection:
            some: list[str] = list(connection.scalars(self._after(self._position, _EXAMINED)))
            if len(some) < _EXAMINED:
                some += connection.scalars(self._after("", _EXAMINED - len(some)))
            if not some:
                return []
            self._position = some[-1]
            found = sa.select(files.c.key).where(files.c.key.in_(some), self._is_unused())
            return sorted(connection.scalars(found))

    def _after(self, key: str, limit: int) -> sa.Select[Any]:
        return sa.select(files.c.key).where(files.c.key > key).order_by(files.c.key).limit(limit)

    def remove_unused(self, key: str, remove: Callable[[str], None]) -> bool:
        """Call `remove` if the file is unused, prevent new pins meanwhile, and return whether the file was removed.

        No transaction is open during the removal: on SQLite it would block all writers.
        """
        with self._database.write() as connection:
            # Lock the row before the test: another transaction may just have committed.
            held = sa.select(files.c.key).where(files.c.key == key).with_for_update()
            if connection.execute(held).first() is None:
                return False
            mine = sa.update(files).where(files.c.key == key, self._is_unused())
            mine = mine.values(pins=_BEING_REMOVED, touched_at=self._database.now())
            if connection.execute(mine.returning(files.c.key)).first() is None:
                return False
        removed = sa.and_(files.c.key == key, files.c.pins == _BEING_REMOVED)
        try:
            remove(key)
        except BaseException:
            with self._database.write() as connection:
                connection.execute(sa.update(files).where(removed).values(pins=0))
            raise
        with self._database.write() as connection:
            connection.execute(sa.delete(files).where(removed))
        return True

    def _is_unused(self) -> sa.ColumnElement[bool]:
        # One condition for each: PostgreSQL looks those up in an index, and reads whole tables for one of them all.
        references = (job_files.c.key, uploads.c.key)
        unneeded = sa.and_(*(~sa.exists().where(column == files.c.key) for column in references))
        unpinned = sa.or_(
            files.c.pins == 0,
            sa.and_(files.c.pins > 0, files.c.touched_at < self._database.now(-_PIN_LASTS_S)),
            sa.and_(files.c.pins < 0, files.c.touched_at < self._database.now(-_REMOVAL_LASTS_S)),
        )
        return sa.and_(unpinned, unneeded)


_FILE = sa.bindparam("file", type_=files.c.key.type)


def _pin(database: Database) -> Any:
    """Return the statement that counts one more pin of a file, unless it is being removed."""
    now = database.now()
    insert = database.upsert(files).values(key=_FILE, pins=1, touched_at=now)
    return insert.on_conflict_do_update(
        index_elements=["key"],
        set_={"pins": sa.case((files.c.pins > 0, files.c.pins + 1), else_=1), "touched_at": now},
        where=sa.or_(files.c.pins >= 0, files.c.touched_at < database.now(-_REMOVAL_LASTS_S)),
    ).returning(files.c.key)


def _unpin(database: Database) -> Any:
    """Return the statement that counts one pin of a file less."""
    now = database.now()
    insert = database.upsert(files).values(key=_FILE, pins=0, touched_at=now)
    fewer = sa.case((files.c.pins > 0, files.c.pins - 1), else_=files.c.pins)
    return insert.on_conflict_do_update(index_elements=["key"], set_={"pins": fewer, "touched_at": now})


def measure(connection: sa.Connection, job_id: str) -> None:
    """Update the bytes of a job's artifacts and checkpoints in its row, after any of them has changed."""
    results = sa.select(total_size(artifacts.c.size)).where(artifacts.c.job_id == job_id).scalar_subquery()
    size = checkpoints.c.size + sa.func.coalesce(checkpoints.c.mesh_size, 0)
    saved = sa.select(total_size(size)).where(checkpoints.c.job_id == job_id).scalar_subquery()
    connection.execute(sa.update(jobs).where(jobs.c.id == job_id).values(stored_bytes=results + saved))
