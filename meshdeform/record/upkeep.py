"""The reconciler's tasks, `record.upkeep`: silent workers, deadlines, retention, and how many jobs wait."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import KindRetiredError, WorkerLostError
from meshdeform.record import rows
from meshdeform.record.changes import JobChange, changing
from meshdeform.record.database import Database
from meshdeform.record.leases import ended, released
from meshdeform.record.models import TERMINAL_STATES, EventType, JobError, JobState
from meshdeform.record.schema import discarded, events, idempotency, jobs, uploads, webhooks
from meshdeform.record.turns import may_start
from meshdeform.requests.choices import RETIRED_KINDS

_BATCH = 100
_UNBLAMED_FACTOR = 10
"""A job fails after so many times `max_attempts` losses without a checkpoint, even if none was blamed on it: it may be
the one that brings its machine down."""
IDEMPOTENCY_KEPT_S = 86_400.0


@dataclass
class Watch:
    """The period during which a reclaimer has watched the leases without a gap, by the record's clock.

    A gap means that the reclaimer was paused (a suspended machine, SIGSTOP), that the clock was set, or that the record
    did not answer; it has just started if there is no earlier look. The workers may have been paused as well, so that
    expired leases prove nothing until one lease has passed, in which every live worker renews its own. `now` is the
    last look, `since` the first one after the last gap.
    """

    lease_s: float
    every_s: float
    now: datetime | None = None
    since: datetime | None = None

    def look(self, now: datetime) -> None:
        """Note a look at the leases."""
        # A worker renews its lease six times as often as it expires, so that a gap of half a lease harms nobody.
        longest = timedelta(seconds=self.every_s + self.lease_s / 2)
        if self.now is None or not timedelta(0) <= now - self.now <= longest:
            self.since = now
        self.now = now

    @property
    def patient(self) -> bool:
        """Whether one lease has passed since the last gap."""
        if self.now is None or self.since is None:
            return False
        return self.now - self.since >= timedelta(seconds=self.lease_s)

    @property
    def renewed_since(self) -> datetime | None:
        """The expiry of a lease renewed at the last gap. Workers with later leases were alive after the gap."""
        return None if self.since is None else self.since + timedelta(seconds=self.lease_s)


@dataclass(frozen=True)
class HeldJob:
    """What a supervisor asks about the job that its worker has."""

    id: str
    attempt: int
    phase: str
    ran_s: float  # seconds for which all its attempts ran until now
    document: Any  # the request, as stored
    canceled: bool
    yields: bool  # whether it is to make room for another job


class Upkeep:
    """Tasks that any number of reconcilers may run at once: each change ends the condition that leads to it."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def clock(self) -> datetime:
        """Return the current time by the record's clock."""
        return self._database.clock()

    def reclaim_expired(self, max_attempts: int, watch: Watch | None = None) -> list[str]:
        """Take back every job whose lease has expired; return the ids of those queued again.

        A job in state `canceling` is canceled. A job that has lost `max_attempts` workers fails (`worker_lost`).
        Without a watch, the caller has watched the leases forever.
        """
        silent: sa.ColumnElement[bool] = jobs.c.lease_expires_at < self._database.now()
        blamed: sa.ColumnElement[bool] = sa.true()
        if watch is not None:
            # Never later than the caller's last look: it may be paused between that look and this statement.
            patient = sa.true() if watch.patient else sa.false()
            silent = sa.and_(jobs.c.lease_expires_at < watch.now, sa.or_(_ended(), patient))
            blamed = sa.or_(_ended(), jobs.c.lease_expires_at >= watch.renewed_since)
        expired = sa.and_(jobs.c.state.in_(rows.OWNED), silent)
        return self._each(expired, lambda change, held: self._take_back(change, held, max_attempts, blamed))

    def _take_back(
        self, change: JobChange, held: sa.ColumnElement[bool], max_attempts: int, blamed: sa.ColumnElement[bool]
    ) -> list[str]:
        lost = WorkerLostError(f"The workers of {max_attempts} attempts died or were cut off.")
        count = jobs.c.lost_attempts + sa.case((blamed, 1), else_=0)
        more = {"lost_attempts": count}
        running = sa.and_(held, jobs.c.state == JobState.RUNNING)
        too_often = _losses_in_a_row() + 1 >= _UNBLAMED_FACTOR * max_attempts
        exhausted = sa.and_(running, sa.or_(count >= max_attempts, too_often))
        # It may have stopped long ago; for so long at most it was alive.
        expired = released(self._database, jobs.c.lease_expires_at)
        failed = {**expired, **more, **ended(self._database, JobState.FAILED, JobError.of(lost))}
        canceled = {**expired, **ended(self._database, JobState.CANCELED)}
        again = {**expired, **more, "state": JobState.QUEUED, "phase": "queued"}
        cancel_requested = sa.and_(held, jobs.c.state == JobState.CANCELING)
        over = change.update(cancel_requested, canceled, EventType.CANCELED)
        over += change.update(exhausted, failed, EventType.FAILED, lambda row: {"error": row.error})
        queued = change.update(running, again, EventType.RECOVERED, lambda row: {"lost_attempts": row.lost_attempts})
        change.counters.add("lease_expirations", value=len(over) + len(queued))
        return [row.id for row in queued]

    def held(self, worker_id: str) -> HeldJob | None:
        """Return what a worker has and whether it is to end; None if it has nothing."""
        ran_s = jobs.c.ran_s + self._database.seconds(jobs.c.claimed_at, self._database.now())
        about = (jobs.c.id, jobs.c.attempt, jobs.c.state, jobs.c.phase, jobs.c.yielded_at, jobs.c.request)
        query = sa.select(*about, ran_s.label("ran_s"))
        with self._database.read() as connection:
            row = connection.execute(query.where(jobs.c.worker_id == worker_id, jobs.c.state.in_(rows.OWNED))).first()
        if row is None:
            return None
        canceled, yields = row.state == JobState.CANCELING, row.yielded_at is not None
        return HeldJob(row.id, row.attempt, row.phase, row.ran_s, row.request, canceled=canceled, yields=yields)

    def shorten_leases(self, lease_s: float) -> int:
        """Shorten leases that end too late because the clock was set back since; return their number."""
        # Twice as long, so that hosts may differ slightly in their settings and clocks.
        ahead = sa.and_(jobs.c.state.in_(rows.OWNED), jobs.c.lease_expires_at > self._database.now(2 * lease_s))

        def cut(change: JobChange, held: sa.ColumnElement[bool]) -> list[str]:
            shorter = sa.update(jobs).where(held).values(lease_expires_at=self._database.now(lease_s))
            return list(change.connection.scalars(shorter.returning(jobs.c.id)))

        return len(self._each(ahead, cut))

    def expire_deadlines(self) -> list[str]:
        """End every job whose deadline has passed; return the ids of those that a worker had.

        A job in state `canceling` is canceled, as was confirmed to its user.
        """
        late = sa.and_(jobs.c.state.in_([JobState.QUEUED, *rows.OWNED]), jobs.c.deadline_at < self._database.now())
        cancel_requested = jobs.c.state == JobState.CANCELING
        values = {
            **ended(self._database, sa.case((cancel_requested, JobState.CANCELED), else_=JobState.EXPIRED)),
            "eta_s": None,
            "ran_s": jobs.c.ran_s + self._database.seconds(jobs.c.claimed_at, self._database.now()),
            "claimed_at": None,
            # Of a failure after which it was to be tried again.
            "error": None,
            "retry_at": None,
        }

        def end(change: JobChange, held: sa.ColumnElement[bool]) -> list[str]:
            over = change.update(held, values, lambda row: EventType(row.state))
            # The lease stays in the row for information; the state prevents further writes of the worker.
            return [row.id for row in over if row.lease_expires_at]

        return self._each(late, end)

    def fail_retired(self) -> None:
        """End every queued job of a kind that no worker runs any more (`kind_retired`)."""
        waiting = sa.and_(jobs.c.state == JobState.QUEUED, jobs.c.kind.in_(sorted(RETIRED_KINDS)))
        error = JobError.of(KindRetiredError("Jobs of this kind are no longer run."))
        values = {**ended(self._database, JobState.FAILED, error), "retry_at": None}

        def end(change: JobChange, held: sa.ColumnElement[bool]) -> list[str]:
            return [row.id for row in change.update(held, values, EventType.FAILED, lambda row: {"error": row.error})]

        self._each(waiting, end)

    def delete_retained(self) -> list[str]:
        """Delete every job whose retention has ended; return their ids. Their objects are due for removal."""
        # An expression, so that SQLite does not choose an index on the state, which finds every finished job.
        finished = (jobs.c.state + "").in_(TERMINAL_STATES)
        over = sa.and_(finished, jobs.c.retain_until < self._database.now())

        def forget(change: JobChange, held: sa.ColumnElement[bool]) -> list[str]:
            ids = list(change.connection.scalars(sa.delete(jobs).where(held).returning(jobs.c.id)))
            change.connection.execute(sa.insert(discarded), [{"prefix": f"jobs/{job_id}/"} for job_id in ids])
            change.connection.execute(sa.delete(webhooks).where(webhooks.c.job_id.in_(ids)))
            return ids

        return self._each(over, forget)

    def delete_stale_requests(self) -> None:
        """Delete idempotency keys older than a day."""
        old = idempotency.c.created_at < self._database.now(-IDEMPOTENCY_KEPT_S)
        with self._database.read() as connection:
            if connection.execute(sa.select(idempotency.c.key).where(old).limit(1)).first() is None:
                return
        with self._database.write() as connection:
            connection.execute(sa.delete(idempotency).where(old))

    def expired_uploads(self) -> list[str]:
        """Return the ids of a batch of expired uploads."""
        over = uploads.c.expires_at < self._database.now()
        with self._database.read() as connection:
            return list(connection.scalars(sa.select(uploads.c.id).where(over).limit(_BATCH)))

    def queued_count(self, most: int, max_running: int = 0) -> int:
        """Return the number of queued jobs that may start, if so many jobs of one owner may run (0: all).

        No more than `most` are counted.
        """
        waiting = sa.select(jobs.c.id).where(may_start(self._database, max_running)).limit(most)
        with self._database.read() as connection:
            return connection.execute(sa.select(sa.func.count()).select_from(waiting.subquery())).scalar_one()

    def queued_ids(self, most: int, max_running: int = 0) -> list[str]:
        """Return the ids of the jobs of `queued_count`, highest priority first."""
        queued = sa.select(jobs.c.id).where(may_start(self._database, max_running))
        with self._database.read() as connection:
            return list(connection.scalars(queued.order_by(jobs.c.priority.desc(), jobs.c.id).limit(most)))

    def discarded_prefixes(self) -> list[str]:
        """Return the prefixes of objects of deleted jobs."""
        with self._database.read() as connection:
            return list(connection.scalars(sa.select(discarded.c.prefix)))

    def forget_discarded(self, prefix: str) -> None:
        """Remove a prefix whose objects have been removed from the store."""
        with self._database.write() as connection:
            connection.execute(sa.delete(discarded).where(discarded.c.prefix == prefix))

    def _each(
        self,
        condition: sa.ColumnElement[bool],
        change_them: Callable[[JobChange, sa.ColumnElement[bool]], list[str]],
    ) -> list[str]:
        """Change the jobs of a condition in batches, one transaction each; return the ids from `change_them`."""
        # The change must end the condition. Rows locked by others are left for the next run, so that reconcilers never
        # wait for each other and cannot deadlock.
        some = sa.select(jobs.c.id).where(condition).limit(_BATCH)
        ids: list[str] = []
        while True:
            with self._database.read() as connection:
                # Usually there is none, and no write lock is needed.
                if connection.execute(some.limit(1)).first() is None:
                    return sorted(ids)
            with changing(self._database) as change:
                held = list(change.connection.scalars(some.with_for_update(skip_locked=True)))
                if held:
                    ids += change_them(change, jobs.c.id.in_(held))
            if not held:
                return sorted(ids)


def _ended() -> sa.ColumnElement[bool]:
    """Return the condition that the job's supervisor has reported the end of its worker (`Leases.worker_ended`)."""
    return jobs.c.worker_id.is_(None)


def _losses_in_a_row() -> sa.ColumnElement[int]:
    """Return the number of recoveries of a job since its last checkpoint."""
    mine = events.c.job_id == jobs.c.id
    last = events.alias("last")
    saved = sa.select(sa.func.max(last.c.seq)).where(last.c.job_id == jobs.c.id, last.c.type == EventType.CHECKPOINT)
    after = events.c.seq > sa.func.coalesce(saved.correlate(jobs).scalar_subquery(), 0)
    lost = sa.select(sa.func.count()).where(mine, events.c.type == EventType.RECOVERED, after)
    return lost.correlate(jobs).scalar_subquery()
