"""Track which stored files are in use, and count what a job keeps; `reconciler` removes what nothing refers to.

Equal bytes are stored once, and removed with the last job that needs them. A request pins its file before storing it,
and the committed row of its job replaces the pin, so that a file cannot be removed while a request relies on it.

The unfinished jobs of an owner, and what all of its jobs store, are kept within their limits.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import TooManyJobsError, TooMuchStoredError, UnavailableError
from meshdeform.record.database import Database
from meshdeform.record.models import JobState
from meshdeform.record.schema import artifacts, checkpoints, files, job_files, jobs, uploads, words

_ACTIVE = (JobState.QUEUED, JobState.RUNNING, JobState.CANCELING)

_OWNER = sa.bindparam("owner", type_=jobs.c.owner_id.type)

_NUMBER = sa.select(sa.func.count()).select_from(jobs).where(jobs.c.owner_id == _OWNER, jobs.c.state.in_(_ACTIVE))

_RETRY_AFTER_S = 3600

_FEW = 10_000
"""Jobs of an owner that are summed up each time."""

_JOBS_PER_S = 20_000
"""A sum of more is kept for as many seconds as it has jobs, divided by this."""


_PIN_LASTS_S = 3600.0
"""Older pins belong to requests whose process died."""

_REMOVAL_LASTS_S = 900.0
"""Longer than any removal takes; older ones belong to a process that died."""

_BEING_REMOVED = -1

_WAIT_S, _POLL_EVERY_S = 30.0, 0.05

_EXAMINED = 300
"""Number of files that one search for unused ones examines; their number must not slow it down."""
_MINE = job_files.c.owner_id == _OWNER
_KNOWN = sa.select(job_files.c.key).where(_MINE, job_files.c.key.in_(sa.bindparam("keys", expanding=True))).distinct()
"""Those of some files that jobs of the owner have already."""
_FILE = sa.bindparam("file", type_=files.c.key.type)


def total_size(size: sa.ColumnElement[int]) -> sa.ColumnElement[int]:
    """Return the sum of a column, 0 if there are no rows."""
    return sa.func.coalesce(sa.func.sum(size), 0)


def check_number(connection: sa.Connection, owner_id: str, limit: int) -> None:
    """Refuse a job of an owner who has as many unfinished ones as allowed; 0: any number (`TooManyJobsError`)."""
    if not limit:
        return
    count = connection.execute(_NUMBER, {"owner": owner_id}).scalar_one()
    if count >= limit:
        raise TooManyJobsError(f"This key has {count} unfinished jobs; its limit is {limit}.", limit=limit)


def _sum_and_known() -> sa.CompoundSelect[Any]:
    """Return one question for both: a row without a key that has the sum, and a row for each known key."""
    each = sa.select(sa.func.max(job_files.c.size).label("size")).where(_MINE).group_by(job_files.c.key).subquery()
    inputs = sa.select(total_size(each.c.size)).scalar_subquery()
    outputs = sa.select(total_size(jobs.c.stored_bytes).label("size"), sa.func.count().label("number"))
    of_jobs = outputs.where(jobs.c.owner_id == _OWNER).subquery()
    nothing: Any = sa.cast(sa.null(), job_files.c.key.type)
    whole = sa.select(nothing.label("key"), (inputs + of_jobs.c.size).label("size"), of_jobs.c.number)
    return sa.union_all(whole, _KNOWN.add_columns(sa.literal(0), sa.literal(0)))


_SUM_AND_KNOWN = _sum_and_known()


@dataclass
class _Sum:
    """The bytes that an owner's jobs keep, with what this process has accepted since they were summed up."""

    size: int
    due: float


class StorageQuotas:
    """How many more bytes each owner may keep in the files of their jobs. Thread-safe.

    For an owner with many jobs the sum is remembered for a while. Meanwhile, what this process accepts is added, and
    what others accept and workers write is not; nobody is refused by a remembered sum.
    """

    def __init__(self) -> None:
        self._sums: dict[str, _Sum] = {}
        self._lock = threading.Lock()

    def check(self, connection: sa.Connection, owner_id: str, files: Mapping[str, int], limit: int) -> int:
        """Refuse a job if its owner would keep more bytes than allowed; return the bytes that it adds.

        `TooMuchStoredError`: there is no room. A file that several jobs of the owner use counts once. Every number
        comes from an index. A limit of 0 means none.
        """
        if not limit:
            return 0
        with self._lock:
            usage = self._sums.get(owner_id)
            remembered = usage.size if usage is not None and time.monotonic() < usage.due else None
        if remembered is not None:
            keys = connection.scalars(_KNOWN, _asked(owner_id, files)) if files else ()
            added = _added(files, set(keys))
            if remembered + max(added, 1) <= limit:
                return added
        stored, added = self._sum_up(connection, owner_id, files)
        if stored >= limit or stored + added > limit:
            raise TooMuchStoredError(
                f"The jobs of this owner keep {stored} bytes, and this one would add {added}; the limit is {limit}.",
                limit=limit,
                stored=stored,
                retry_after_s=_RETRY_AFTER_S,
            )
        return added

    def accepted(self, owner_id: str, added: int) -> None:
        """Note the bytes of a job that was accepted after a `check`."""
        with self._lock:
            if owner_id in self._sums:
                self._sums[owner_id].size += added

    def _sum_up(self, connection: sa.Connection, owner_id: str, files: Mapping[str, int]) -> tuple[int, int]:
        """Return the bytes that the owner's jobs keep, and what these files add; remember the sum of many jobs."""
        began = time.monotonic()
        rows = {row.key: row for row in connection.execute(_SUM_AND_KNOWN, _asked(owner_id, files))}
        row = rows.pop(None)
        stored, number = int(row.size), int(row.number)
        with self._lock:
            self._sums.pop(owner_id, None)
            if number > _FEW:
                self._sums[owner_id] = _Sum(stored, began + number / _JOBS_PER_S)
        return stored, _added(files, set(rows))


def _asked(owner_id: str, files: Mapping[str, int]) -> dict[str, Any]:
    return {"owner": owner_id, "keys": sorted(files)}


def _added(files: Mapping[str, int], known: set[str]) -> int:
    return sum(size for key, size in files.items() if key not in known)


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

        Raises UnavailableError: the removal takes too long: the object store is slow or does not answer.
        """
        end = time.monotonic() + _WAIT_S
        while not self._pinned(key):
            if time.monotonic() > end:
                raise UnavailableError("The file is being removed, and the object store does not answer.")
            time.sleep(_POLL_EVERY_S)

    def _pinned(self, key: str) -> bool:
        with self._database.write() as connection:
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
            keys = sa.select(files.c.key).where(files.c.key.in_(some), self._is_unused())
            return sorted(connection.scalars(keys))

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
        references = (job_files.c.key, uploads.c.key, words.c.key)
        unneeded = sa.and_(*(~sa.exists().where(column == files.c.key) for column in references))
        unpinned = sa.or_(
            files.c.pins == 0,
            sa.and_(files.c.pins > 0, files.c.touched_at < self._database.now(-_PIN_LASTS_S)),
            sa.and_(files.c.pins < 0, files.c.touched_at < self._database.now(-_REMOVAL_LASTS_S)),
        )
        return sa.and_(unpinned, unneeded)


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
