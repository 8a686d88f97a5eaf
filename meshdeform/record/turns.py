"""Decide which queued job comes next: by priority, and within one the owners in turn, by the time that they have run.

A job that has run for long while others wait is handed over: it stops as if its worker did, and its owner rests.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import sqlalchemy as sa

from meshdeform.record.database import Database
from meshdeform.record.models import Job, JobState
from meshdeform.record.rows import OWNED
from meshdeform.record.schema import jobs
from meshdeform.settings import Settings

Ids = sa.Select[tuple[str]]
_CLAIMS = 0x636C61696D  # an arbitrary number, unlikely to be used by another program


@dataclass(frozen=True)
class Turns:
    """How owners share the workers."""

    turn_s: float = 300.0
    """Seconds for which a job of another owner waits before one that has run for as long is handed over to it."""
    max_running: int = 0  # largest number of jobs of one owner that run at the same time; 0: no limit

    @classmethod
    def of(cls, settings: Settings) -> Self:
        """Return those of a deployment."""
        return cls(settings.turn_s, settings.max_running_jobs)


USUAL = Turns()


def may_start(database: Database, max_running: int) -> sa.ColumnElement[bool]:
    """Return the condition that a job is queued, not postponed, and within its owner's limit of running jobs."""
    now = sa.and_(jobs.c.state == JobState.QUEUED, sa.or_(jobs.c.retry_at.is_(None), jobs.c.retry_at <= database.now()))
    if not max_running:
        return now
    return sa.and_(now, jobs.c.owner_id.not_in(_running().having(sa.func.count() >= max_running)))


def hold_claims(database: Database, connection: sa.Connection, turns: Turns) -> None:
    """Let no other claim count the running jobs before this transaction has ended; on SQLite none can anyway."""
    if turns.max_running and not database.is_sqlite:
        connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_CLAIMS)))


def choices(database: Database, readable: Ids, turns: Turns, served: Any) -> tuple[Ids, ...]:
    """Return the queries for the next job among readable ones, of which the first that finds one decides.

    `served` is the owner whose job was taken last. An owner that has just handed a job over rests for as long as a turn
    lasts, unless only such owners wait.
    """
    free = readable.where(may_start(database, turns.max_running))
    by_urgency = free.order_by(jobs.c.priority.desc(), jobs.c.id)
    top = by_urgency.with_only_columns(jobs.c.priority).limit(1).scalar_subquery()
    equal = free.where(jobs.c.priority == top)
    yielded = sa.and_(jobs.c.state == JobState.QUEUED, jobs.c.yielded_at > database.now(-turns.turn_s))
    # In the order of an index (ix_jobs_share), so that each is one look-up in it.
    in_turn = equal.where(jobs.c.owner_id.not_in(sa.select(jobs.c.owner_id).where(yielded)))
    in_turn = in_turn.order_by(jobs.c.owner_id, jobs.c.id)
    first_yielded = equal.where(jobs.c.yielded_at.is_not(None)).order_by(jobs.c.yielded_at)
    # After the last owner comes the first; the last choice is for when other workers hold all of that priority.
    return in_turn.where(jobs.c.owner_id > served), in_turn, first_yielded, by_urgency


def waits_longer(database: Database, readable: Ids, turns: Turns, job: Job) -> Ids:
    """Return the query for a job for which a running one should make room, beyond those for which others already do.

    It has waited for a turn and has a higher priority, or the same one and an owner with fewer running jobs.
    """
    others = sa.and_(jobs.c.state.in_(OWNED), jobs.c.yielded_at.is_not(None))
    leaving = sa.select(sa.func.count()).select_from(jobs).where(others).scalar_subquery()
    staying = _running().where(jobs.c.yielded_at.is_(None))
    number = sa.select(sa.func.count()).select_from(jobs)
    mine = number.where(jobs.c.state.in_(OWNED), jobs.c.yielded_at.is_(None), jobs.c.owner_id == job.owner_id)
    # Whoever comes in the place of one that leaves may be of any of them.
    as_many = staying.having(sa.func.count() + leaving >= mine.scalar_subquery())
    behind = sa.and_(jobs.c.priority == job.priority, jobs.c.owner_id.not_in(as_many))
    since = sa.func.coalesce(jobs.c.yielded_at, jobs.c.created_at)
    long = sa.and_(since <= database.now(-turns.turn_s), sa.or_(jobs.c.priority > job.priority, behind))
    return readable.where(may_start(database, turns.max_running), long).limit(1).offset(leaving)


def _running() -> Ids:
    """Return the query for the owners of running jobs, in groups."""
    return sa.select(jobs.c.owner_id).where(jobs.c.state.in_(OWNED)).group_by(jobs.c.owner_id)
