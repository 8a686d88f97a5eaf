"""What the reconciler does, `record.upkeep`: silent workers, deadlines, retention, and who is still to be told."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import WorkerLostError
from meshdeform.record import rows
from meshdeform.record.changes import Change, Row, changing
from meshdeform.record.database import Database
from meshdeform.record.leases import RELEASED
from meshdeform.record.models import TERMINAL_STATES, EventType, JobError, JobState
from meshdeform.record.schema import discarded, idempotency, jobs, outbox, uploads

__all__ = ["IDEMPOTENCY_KEPT_S", "Upkeep"]

_BATCH = 100
IDEMPOTENCY_KEPT_S = 86_400.0


class Upkeep:
    """Any number of reconcilers may do this at once: what one has changed, another does not find any more."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def reclaim_expired(self, max_attempts: int) -> list[str]:
        """Take back every job whose lease is over; return the ids that are queued again.

        A job that was to be canceled is canceled. One that has now lost `max_attempts` workers fails (`worker_lost`).
        """
        expired = sa.and_(jobs.c.state.in_(rows.OWNED), jobs.c.lease_expires_at < self._database.now())
        return self._each(expired, lambda change, held: self._take_back(change, held, max_attempts))

    def _take_back(self, change: Change, held: sa.ColumnElement[bool], max_attempts: int) -> list[str]:
        lost = WorkerLostError(f"The workers of {max_attempts} attempts died or were cut off.")
        over = {"finished_at": self._database.now(), "phase": "done"}
        more = {"lost_attempts": jobs.c.lost_attempts + 1}
        running = sa.and_(held, jobs.c.state == JobState.RUNNING)
        exhausted = sa.and_(running, jobs.c.lost_attempts + 1 >= max_attempts)
        failed = {**RELEASED, **over, **more, "state": JobState.FAILED, "error": JobError.of(lost).model_dump()}
        canceled = {**RELEASED, **over, "state": JobState.CANCELED}
        again = {**RELEASED, **more, "state": JobState.QUEUED, "phase": "queued"}
        asked = sa.and_(held, jobs.c.state == JobState.CANCELING)
        ended = change.update(asked, canceled, EventType.CANCELED)
        ended += change.update(exhausted, failed, EventType.FAILED, lambda row: {"error": row.error})
        queued = change.update(running, again, EventType.RECOVERED, _lost_attempt)
        change.counters.add("lease_expirations", value=len(ended) + len(queued))
        return [row.id for row in queued]

    def shorten_leases(self, lease_s: float) -> int:
        """Cut leases that end later than one given now could: the clock was set back after they were given.

        Returns
        -------
        int
            How many there were.
        """
        # Twice as long, so that hosts may differ a little in their settings and their clocks.
        ahead = sa.and_(jobs.c.state.in_(rows.OWNED), jobs.c.lease_expires_at > self._database.now(2 * lease_s))

        def cut(change: Change, held: sa.ColumnElement[bool]) -> list[str]:
            shorter = sa.update(jobs).where(held).values(lease_expires_at=self._database.now(lease_s))
            return list(change.connection.scalars(shorter.returning(jobs.c.id)))

        return len(self._each(ahead, cut))

    def expire_deadlines(self) -> list[str]:
        """End every job whose deadline is over; return the ids of those that a worker had.

        One that was to be canceled is canceled: its user was told so.
        """
        late = sa.and_(jobs.c.state.in_([JobState.QUEUED, *rows.OWNED]), jobs.c.deadline_at < self._database.now())
        asked = jobs.c.state == JobState.CANCELING
        values = {
            "state": sa.case((asked, JobState.CANCELED), else_=JobState.EXPIRED),
            "finished_at": self._database.now(),
            "phase": "done",
            "eta_s": None,
        }

        def end(change: Change, held: sa.ColumnElement[bool]) -> list[str]:
            ended = change.update(held, values, lambda row: EventType(row.state))
            # The lease stays in the row for whoever reads it; nothing can be written with it any more.
            return [row.id for row in ended if row.lease_expires_at]

        return self._each(late, end)

    def delete_retained(self) -> list[str]:
        """Delete every job whose time is over; return their ids. Their objects are due for removal now."""
        over = sa.and_(jobs.c.state.in_(TERMINAL_STATES), jobs.c.retain_until < self._database.now())

        def forget(change: Change, held: sa.ColumnElement[bool]) -> list[str]:
            ids = list(change.connection.scalars(sa.delete(jobs).where(held).returning(jobs.c.id)))
            change.connection.execute(sa.insert(discarded), [{"prefix": f"jobs/{job_id}/"} for job_id in ids])
            return ids

        return self._each(over, forget)

    def delete_stale_requests(self) -> None:
        """Forget idempotency keys that are a day old."""
        old = idempotency.c.created_at < self._database.now(-IDEMPOTENCY_KEPT_S)
        with self._database.read() as connection:
            if connection.execute(sa.select(idempotency.c.key).where(old).limit(1)).first() is None:
                return
        with self._database.write() as connection:
            connection.execute(sa.delete(idempotency).where(old))

    def expired_uploads(self) -> list[str]:
        """Return the ids of uploads whose time is over, some at a time."""
        over = uploads.c.expires_at < self._database.now()
        with self._database.read() as connection:
            return list(connection.scalars(sa.select(uploads.c.id).where(over).limit(_BATCH)))

    def untold(self) -> list[str]:
        """Return the jobs whose workers are still to be told, oldest first."""
        with self._database.read() as connection:
            return list(connection.scalars(sa.select(outbox.c.job_id).order_by(outbox.c.job_id)))

    def told(self, job_ids: Collection[str]) -> None:
        """Their workers are told: take them off the outbox."""
        ids = sorted(job_ids)
        with self._database.write() as connection:
            for start in range(0, len(ids), _BATCH):
                some = outbox.c.job_id.in_(ids[start : start + _BATCH])
                # One that somebody holds stays for the next look: its job ends this moment, or it is told by another.
                free = sa.select(outbox.c.job_id).where(some).with_for_update(skip_locked=True).cte("free")
                connection.execute(sa.delete(outbox).where(outbox.c.job_id.in_(sa.select(free.c.job_id))))

    def queued_count(self) -> int:
        """Return how many jobs are queued."""
        count = sa.select(sa.func.count()).select_from(jobs).where(jobs.c.state == JobState.QUEUED)
        with self._database.read() as connection:
            return connection.execute(count).scalar_one()

    def queued_ids(self) -> list[str]:
        """Return the queued jobs, the most urgent first."""
        queued = sa.select(jobs.c.id).where(jobs.c.state == JobState.QUEUED)
        with self._database.read() as connection:
            return list(connection.scalars(queued.order_by(jobs.c.priority.desc(), jobs.c.id)))

    def discarded_prefixes(self) -> list[str]:
        """Return the prefixes of objects that belonged to deleted jobs."""
        with self._database.read() as connection:
            return list(connection.scalars(sa.select(discarded.c.prefix)))

    def forget_discarded(self, prefix: str) -> None:
        """The store holds nothing under the prefix any more."""
        with self._database.write() as connection:
            connection.execute(sa.delete(discarded).where(discarded.c.prefix == prefix))

    def _each(
        self,
        condition: sa.ColumnElement[bool],
        change_them: Callable[[Change, sa.ColumnElement[bool]], list[str]],
    ) -> list[str]:
        """Change the jobs of a condition, some in each transaction, which holds their rows; return the ids it gives.

        The change must end the condition. Rows that somebody else holds are left for the next look: so those who change
        many never wait for each other, least of all in a circle.
        """
        some = sa.select(jobs.c.id).where(condition).limit(_BATCH)
        ids: list[str] = []
        while True:
            with self._database.read() as connection:
                # Almost always there is none, and then nobody need wait for a write lock.
                if connection.execute(some.limit(1)).first() is None:
                    return sorted(ids)
            with changing(self._database) as change:
                held = list(change.connection.scalars(some.with_for_update(skip_locked=True)))
                if held:
                    ids += change_them(change, jobs.c.id.in_(held))
            if not held:
                return sorted(ids)


def _lost_attempt(row: Row) -> dict[str, Any]:
    return {"lost_attempts": row.lost_attempts}
