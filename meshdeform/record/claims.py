"""Claim queued jobs for workers: which job is next, among those that this process can read."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import UnreadableJobError
from meshdeform.record import rows
from meshdeform.record.changes import Change, changing
from meshdeform.record.database import Database
from meshdeform.record.models import EventType, Job, JobState
from meshdeform.record.schema import jobs
from meshdeform.requests.document import params_by_kind

__all__ = ["Claims"]

_log = logging.getLogger(__name__)
_Ids = sa.Select[tuple[str]]
_queued = jobs.c.state == JobState.QUEUED


class Claims:
    """Claims of queued jobs. Those that only another version can read are left to its workers."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._served: str | None = None
        self._unreadable: set[str] = set()

    def claim(self, job_id: str, worker_id: str, lease_s: float) -> Job | None:
        """Claim a queued job as a new attempt. None: it is not queued, is over, was deleted, or cannot be read here."""
        return self._claim(lambda readable: (readable.where(jobs.c.id == job_id),), worker_id, lease_s)

    def claim_next(self, worker_id: str, lease_s: float) -> Job | None:
        """Claim a queued job of the highest priority; return None if none is queued that this process can read.

        Owners with jobs of that priority take turns, each with its oldest job, so that a job waits for one job of every
        other owner and not for all that were queued before.
        """
        job = self._claim(self._in_turn, worker_id, lease_s)
        if job is not None:
            self._served = job.owner_id
        return job

    def _in_turn(self, readable: _Ids) -> tuple[_Ids, ...]:
        by_urgency = readable.order_by(jobs.c.priority.desc(), jobs.c.id)
        top = by_urgency.with_only_columns(jobs.c.priority).limit(1).scalar_subquery()
        # In the order of an index (ix_jobs_share), so that each is one look-up in it.
        in_turn = readable.where(jobs.c.priority == top).order_by(jobs.c.owner_id, jobs.c.id)
        after = in_turn.where(jobs.c.owner_id > self._last_served())
        # After the last owner comes the first; the last choice is for when other workers hold all of that priority.
        return after, in_turn, by_urgency

    def _last_served(self) -> Any:
        """Return the owner whom this process served last, else the one whom any worker did."""
        if self._served is not None:
            return self._served
        running = sa.select(jobs.c.owner_id).where(jobs.c.state == JobState.RUNNING)
        newest = running.order_by(jobs.c.started_at.desc()).limit(1).scalar_subquery()
        return sa.func.coalesce(newest, "")

    def _claim(self, choose: Callable[[_Ids], tuple[_Ids, ...]], worker_id: str, lease_s: float) -> Job | None:
        """Claim the first job of the first choice that has one, passing over jobs that only other versions can read."""
        while True:
            job = None
            try:
                with changing(self._database) as change:
                    job = self._take(change, choose(self._readable()), worker_id, lease_s)
                    if job is not None:
                        _ = job.request
                    return job
            except UnreadableJobError as error:
                # The transaction is rolled back. Requests never change, so that each job is tried once.
                assert job is not None
                _log.warning("job %s is left to workers that can read it: %s", job.id, error.detail)
                self._unreadable.add(job.id)

    def _readable(self) -> _Ids:
        """Return the query for the queued jobs that this process can read, as far as it knows."""
        query = sa.select(jobs.c.id).where(_queued, jobs.c.kind.in_(sorted(params_by_kind())))
        if not self._unreadable:
            return query
        # One parameter, however many they are.
        ids = sa.literal(sorted(self._unreadable), sa.JSON)
        members = sa.func.json_each(ids) if self._database.is_sqlite else sa.func.json_array_elements_text(ids)
        return query.where(jobs.c.id.not_in(sa.select(members.table_valued("value").c.value)))

    def _take(self, change: Change, choices: Sequence[_Ids], worker_id: str, lease_s: float) -> Job | None:
        now = self._database.now()
        values = {
            "state": JobState.RUNNING,
            "attempt": jobs.c.attempt + 1,
            "worker_id": worker_id,
            "lease_expires_at": self._database.now(lease_s),
            "started_at": sa.func.coalesce(jobs.c.started_at, now),
            "phase": "loading",
        }
        for choice in choices:
            free = choice.limit(1).with_for_update(skip_locked=True).scalar_subquery()
            if taken := change.update(sa.and_(jobs.c.id == free, _queued), values, EventType.STARTED):
                break
        else:
            return None
        row = taken[0]
        if row.attempt == 1:
            change.counters.observe("queue_wait_seconds", (row.started_at - row.created_at).total_seconds())
        return rows.job(row)
