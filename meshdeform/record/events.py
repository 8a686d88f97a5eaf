"""Read the events of jobs, in order and without gaps: the source of every event stream."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import sqlalchemy as sa

from meshdeform.record import rows
from meshdeform.record.changes import find_job
from meshdeform.record.database import Database
from meshdeform.record.models import Event, JobState
from meshdeform.record.schema import events, jobs
from meshdeform.requests.choices import member_of

_BATCH = 500


@dataclass(frozen=True)
class Head:
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
            found = [rows.event(row) for row in connection.execute(query.limit(limit))]
            if not found or owner is not None:
                find_job(connection, job_id, owner)
        return found

    def heads(self, job_ids: Collection[str]) -> dict[str, Head]:
        """Return the current positions of jobs, without deleted ones, in one query per 500 jobs."""
        found: dict[str, Head] = {}
        ids = sorted(job_ids)
        for start in range(0, len(ids), _BATCH):
            query = sa.select(jobs.c.id, jobs.c.event_seq, jobs.c.version, jobs.c.state)
            query = query.where(jobs.c.id.in_(ids[start : start + _BATCH]))
            with self._database.read() as connection:
                for row in connection.execute(query):
                    found[row.id] = Head(row.event_seq, row.version, member_of(JobState, row.state))
        return found
