"""Keep the unfinished jobs of an owner, and what all of its jobs store, within their limits."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import TooManyJobsError, TooMuchStoredError
from meshdeform.record.models import JobState
from meshdeform.record.schema import job_files, jobs

__all__ = ["Rooms", "check_number", "total_size"]

_ACTIVE = (JobState.QUEUED, JobState.RUNNING, JobState.CANCELING)
_OWNER = sa.bindparam("owner", type_=jobs.c.owner_id.type)
_NUMBER = sa.select(sa.func.count()).select_from(jobs).where(jobs.c.owner_id == _OWNER, jobs.c.state.in_(_ACTIVE))
_RETRY_AFTER_S = 3600
_FEW = 10_000
"""Jobs of an owner that are summed up each time."""
_JOBS_PER_S = 20_000
"""A sum of more is kept for as many seconds as it has jobs, divided by this."""


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


_MINE = job_files.c.owner_id == _OWNER
_KNOWN = sa.select(job_files.c.key).where(_MINE, job_files.c.key.in_(sa.bindparam("keys", expanding=True))).distinct()
"""Those of some files that jobs of the owner have already."""


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


class Rooms:
    """The room of each owner. Thread-safe.

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
            found = self._sums.get(owner_id)
            remembered = found.size if found is not None and time.monotonic() < found.due else None
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
        found = {row.key: row for row in connection.execute(_SUM_AND_KNOWN, _asked(owner_id, files))}
        row = found.pop(None)
        stored, number = int(row.size), int(row.number)
        with self._lock:
            self._sums.pop(owner_id, None)
            if number > _FEW:
                self._sums[owner_id] = _Sum(stored, began + number / _JOBS_PER_S)
        return stored, _added(files, set(found))


def _asked(owner_id: str, files: Mapping[str, int]) -> dict[str, Any]:
    return {"owner": owner_id, "keys": sorted(files)}


def _added(files: Mapping[str, int], known: set[str]) -> int:
    return sum(size for key, size in files.items() if key not in known)
