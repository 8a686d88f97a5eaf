"""Change jobs together with their events, webhook messages and counters, in one transaction."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects.postgresql import ARRAY, JSONB

from meshdeform.errors import NotFoundError, StaleAttemptError
from meshdeform.record import rows
from meshdeform.record.counters import Counters
from meshdeform.record.database import Database, NewRow, insert
from meshdeform.record.deliveries import write_deliveries
from meshdeform.record.models import Event, EventType, Job, JobState, Progress
from meshdeform.record.schema import checkpoints, discarded, events, jobs
from meshdeform.record.usage import UsageCounts
from meshdeform.requests.choices import member_of

Row = sa.Row[Any]
_BATCH = 500


class JobChange:
    """A transaction that changes jobs, created by `changing`."""

    def __init__(self, database: Database, connection: sa.Connection) -> None:
        self.connection, self.counters = connection, Counters(database, connection)
        self.usage = UsageCounts(database, connection)
        self._database = database

    def update(
        self,
        where: sa.ColumnElement[bool],
        values: dict[str, Any],
        happened: EventType | Callable[[Row], EventType] | None = None,
        data: Callable[[Row], dict[str, Any]] | dict[str, Any] | None = None,
    ) -> list[Row]:
        """Change the jobs that satisfy a condition, write an event for each, and return the changed rows.

        The event and its data may be functions of the changed row; without an event, none is written. A change of
        `ran_s` ends an attempt, whose seconds are counted as its owner's.
        """
        ran_s = self._ran_s(where) if "ran_s" in values else {}
        change = sa.update(jobs).where(where).values(version=jobs.c.version + 1, **values)
        if happened is not None:
            change = change.values(event_seq=jobs.c.event_seq + 1)
        changed = list(self.connection.execute(change.returning(jobs)).all())
        for row in changed if ran_s else ():
            self.usage.add(row.owner_id, seconds=row.ran_s - ran_s[row.id])
        if happened is not None:
            for number, row in enumerate(changed):
                kind = happened if isinstance(happened, EventType) else happened(row)
                changed[number] = self.write_event(row, kind, data(row) if callable(data) else data)
        return changed

    def _ran_s(self, where: sa.ColumnElement[bool]) -> dict[str, float]:
        """Return for how long jobs had run before; they are locked, so that none that is changed is missing here."""
        before = sa.select(jobs.c.id, jobs.c.ran_s).where(where).with_for_update()
        return {row.id: row.ran_s for row in self.connection.execute(before)}

    def write_event(self, row: Row, happened: EventType, data: dict[str, Any] | None = None) -> Row:
        """Write the event with the number in `row.event_seq` and its consequences; return the row afterwards."""
        values = {
            "job_id": row.id,
            "seq": row.event_seq,
            "type": happened,
            "at": self._database.now(),
            "attempt": row.attempt,
            "data": data or {},
        }
        event = rows.event(insert(self.connection, self._database, NewRow(events, values)))
        if happened is EventType.RECOVERED:
            self.counters.add("recoveries")
        if happened.terminal:
            row = self._ended(row)
        write_deliveries(self.connection, self._database, rows.job(row), event)
        return row

    def _ended(self, row: Row) -> Row:
        if row.retention_s:
            until = sa.update(jobs).where(jobs.c.id == row.id)
            until = until.values(retain_until=self._database.now(row.retention_s))
            row = self.connection.execute(until.returning(jobs)).one()
        if row.attempt > 1:
            self._discard_lost_attempts(row)
        self.counters.add("jobs_ended", row.state)
        self.usage.add(row.owner_id, jobs=1)
        if row.started_at is not None and row.finished_at is not None:
            self.counters.observe("job_seconds", (row.finished_at - row.started_at).total_seconds())
        return row

    def _discard_lost_attempts(self, row: Row) -> None:
        """Discard the objects of earlier attempts, except attempts with a recorded checkpoint."""
        kept = sa.select(checkpoints.c.attempt).where(checkpoints.c.job_id == row.id).distinct()
        lost = set(range(1, row.attempt)) - set(self.connection.scalars(kept))
        if lost:
            prefixes = [{"prefix": f"jobs/{row.id}/{attempt}/"} for attempt in sorted(lost)]
            self.connection.execute(sa.insert(discarded), prefixes)


def with_progress_event(database: Database, change: sa.Update, progress: Progress) -> sa.Select[Any]:
    """Return the one statement of PostgreSQL that changes a job and writes its progress event, as `Change.update` does.

    It returns the job's state. No webhook asks for these events.
    """
    mine = (jobs.c.id, jobs.c.event_seq, jobs.c.attempt, jobs.c.fraction, jobs.c.state)
    changed = change.values(event_seq=jobs.c.event_seq + 1).returning(*mine).cte("changed")
    # The fraction is all that the record may know better.
    known = sa.cast(progress.model_dump(mode="json"), JSONB)
    path = sa.literal(["fraction"], ARRAY(sa.Text))
    values: dict[sa.Column[Any], Any] = {
        events.c.job_id: changed.c.id,
        events.c.seq: changed.c.event_seq,
        events.c.type: sa.literal(EventType.PROGRESS),
        events.c.at: database.now(),
        events.c.attempt: changed.c.attempt,
        events.c.data: sa.cast(sa.func.jsonb_set(known, path, sa.func.to_jsonb(changed.c.fraction)), sa.JSON),
    }
    announced_event = sa.insert(events).from_select(list(values), sa.select(*values.values())).cte("told")
    return sa.select(changed.c.state).add_cte(announced_event)


@contextmanager
def changing(database: Database) -> Iterator[JobChange]:
    """Open a transaction that changes jobs, and write its counters and what owners used at its end."""
    with database.write() as connection:
        change = JobChange(database, connection)
        yield change
        change.usage.write()
        change.counters.write()


def hold(connection: sa.Connection, job_id: str, attempt: int) -> None:
    """Lock the row of a job until the end of the transaction; `StaleAttemptError`: another attempt has the job."""
    held = sa.select(jobs.c.id).where(rows.fenced(job_id, attempt)).with_for_update()
    if connection.execute(held).first() is None:
        raise stale(connection, job_id, attempt)


def stale(connection: sa.Connection, job_id: str, attempt: int) -> StaleAttemptError:
    """Return the error that explains why a write of this attempt was refused; `NotFoundError`: the job was deleted."""
    now = find_job(connection, job_id)
    return StaleAttemptError(f"Attempt {attempt} is over: the job is {now.state}, attempt {now.attempt}.")


def find_job(connection: sa.Connection, job_id: str, owner: str | None = None) -> Job:
    """Return a job; `NotFoundError`: there is no such job, or another owner than the one named has it."""
    query = sa.select(jobs).where(jobs.c.id == job_id)
    if owner is not None:
        query = query.where(jobs.c.owner_id == owner)
    row = connection.execute(query).one_or_none()
    if row is None:
        raise NotFoundError(f"There is no job {job_id!r}.")
    return rows.job(row)


@dataclass(frozen=True)
class JobPosition:
    """The current position of a job: the number of its newest event, its version and its state."""

    seq: int
    version: int
    state: JobState


class EventLog:
    """The events of all jobs, for reading; they are written with the changes that cause them (`changes.py`)."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def after(self, job_id: str, seq: int = 0, limit: int = 1000, owner: str | None = None) -> list[Event]:
        """Return at most `limit` events of a job after number `seq`, oldest first; `NotFoundError`: no such job."""
        query = sa.select(events).where(events.c.job_id == job_id, events.c.seq > seq).order_by(events.c.seq)
        with self._database.read() as connection:
            events_after = [rows.event(row) for row in connection.execute(query.limit(limit))]
            if not events_after or owner is not None:
                find_job(connection, job_id, owner)
        return events_after

    def heads(self, job_ids: Collection[str]) -> dict[str, JobPosition]:
        """Return the current positions of jobs, without deleted ones, in one query per 500 jobs."""
        heads: dict[str, JobPosition] = {}
        ids = sorted(job_ids)
        for start in range(0, len(ids), _BATCH):
            query = sa.select(jobs.c.id, jobs.c.event_seq, jobs.c.version, jobs.c.state)
            query = query.where(jobs.c.id.in_(ids[start : start + _BATCH]))
            with self._database.read() as connection:
                for row in connection.execute(query):
                    heads[row.id] = JobPosition(row.event_seq, row.version, member_of(JobState, row.state))
        return heads
