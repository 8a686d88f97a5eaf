"""A change to jobs, with all that belongs to it in one transaction: events, messages to webhooks, outbox, counters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import NotFoundError, StaleAttemptError
from meshdeform.record import rows
from meshdeform.record.counters import Counters
from meshdeform.record.database import Database
from meshdeform.record.deliveries import write_deliveries
from meshdeform.record.models import EventType, Job, JobState
from meshdeform.record.schema import checkpoints, discarded, events, jobs, outbox

__all__ = ["Change", "Row", "changing", "find_job", "hold", "stale"]

Row = sa.Row[Any]


class Change:
    """One transaction that changes jobs; made by `changing`."""

    def __init__(self, database: Database, connection: sa.Connection) -> None:
        self.connection, self.counters = connection, Counters(database, connection)
        self._database = database

    def update(
        self,
        where: sa.ColumnElement[bool],
        values: dict[str, Any],
        happened: EventType | Callable[[Row], EventType] | None = None,
        data: Callable[[Row], dict[str, Any]] | dict[str, Any] | None = None,
    ) -> list[Row]:
        """Change the jobs that a condition names.

        Parameters
        ----------
        where : condition
        values : dict
            New values of columns.
        happened : EventType or callable, optional
            The event of each of them, or what tells it from the changed row.
        data : dict or callable, optional
            The event's data, or what makes it from the changed row.

        Returns
        -------
        list of rows, as they are now
        """
        change = sa.update(jobs).where(where).values(version=jobs.c.version + 1, **values)
        if happened is not None:
            change = change.values(event_seq=jobs.c.event_seq + 1)
        changed = list(self.connection.execute(change.returning(jobs)).all())
        if happened is not None:
            for place, row in enumerate(changed):
                kind = happened if isinstance(happened, EventType) else happened(row)
                changed[place] = self.tell(row, kind, data(row) if callable(data) else data)
        return changed

    def tell(self, row: Row, happened: EventType, data: dict[str, Any] | None = None) -> Row:
        """Write the event whose number the row carries, and all that follows from it; return the row as it is then."""
        values = {
            "job_id": row.id,
            "seq": row.event_seq,
            "type": happened,
            "at": self._database.now(),
            "attempt": row.attempt,
            "data": data or {},
        }
        event = rows.event(self.connection.execute(sa.insert(events).values(values).returning(events)).one())
        if happened in (EventType.QUEUED, EventType.RECOVERED) and row.state == JobState.QUEUED:
            insert = self._database.upsert(outbox).values(job_id=row.id, created_at=self._database.now())
            self.connection.execute(insert.on_conflict_do_nothing())
        if happened is EventType.RECOVERED:
            self.counters.add("recoveries")
        if happened.terminal:
            row = self._ended(row)
        write_deliveries(self.connection, self._database, rows.job(row), event)
        return row

    def _ended(self, row: Row) -> Row:
        self.connection.execute(sa.delete(outbox).where(outbox.c.job_id == row.id))
        if row.retention_s:
            until = sa.update(jobs).where(jobs.c.id == row.id)
            until = until.values(retain_until=self._database.now(row.retention_s))
            row = self.connection.execute(until.returning(jobs)).one()
        if row.attempt > 1:
            self._discard_lost_attempts(row)
        self.counters.add("jobs_ended", row.state)
        if row.started_at is not None and row.finished_at is not None:
            self.counters.observe("job_seconds", (row.finished_at - row.started_at).total_seconds())
        return row

    def _discard_lost_attempts(self, row: Row) -> None:
        """Give up the objects of earlier attempts, but not of those with a checkpoint that the record points at."""
        kept = sa.select(checkpoints.c.attempt).where(checkpoints.c.job_id == row.id).distinct()
        lost = set(range(1, row.attempt)) - set(self.connection.scalars(kept))
        if lost:
            prefixes = [{"prefix": f"jobs/{row.id}/{attempt}/"} for attempt in sorted(lost)]
            self.connection.execute(sa.insert(discarded), prefixes)


@contextmanager
def changing(database: Database) -> Iterator[Change]:
    """Open a transaction that changes jobs; what it counted is written at its end."""
    with database.write() as connection:
        change = Change(database, connection)
        yield change
        change.counters.write()


def hold(connection: sa.Connection, job_id: str, attempt: int) -> None:
    """Lock the row of a job until the end of the transaction.

    Raises
    ------
    StaleAttemptError
        The attempt does not have the job any more.
    """
    held = sa.select(jobs.c.id).where(rows.fenced(job_id, attempt)).with_for_update()
    if connection.execute(held).first() is None:
        raise stale(connection, job_id, attempt)


def stale(connection: sa.Connection, job_id: str, attempt: int) -> StaleAttemptError:
    """Return the error that says why a write of this attempt was refused.

    Raises
    ------
    NotFoundError
        The job is gone.
    """
    now = find_job(connection, job_id)
    return StaleAttemptError(f"Attempt {attempt} is over: the job is {now.state}, attempt {now.attempt}.")


def find_job(connection: sa.Connection, job_id: str, owner: str | None = None) -> Job:
    """Return a job; with an owner, only if it is theirs.

    Raises
    ------
    NotFoundError
        There is none. Whether somebody else has one of this id is not told.
    """
    query = sa.select(jobs).where(jobs.c.id == job_id)
    if owner is not None:
        query = query.where(jobs.c.owner_id == owner)
    row = connection.execute(query).one_or_none()
    if row is None:
        raise NotFoundError(f"There is no job {job_id!r}.")
    return rows.job(row)
