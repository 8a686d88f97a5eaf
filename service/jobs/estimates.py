"""Estimate how long a job will wait and run, from the other jobs in the record."""

from __future__ import annotations

import heapq
import statistics
from dataclasses import dataclass
from typing import Any, Self

import sqlalchemy as sa

from meshdeform.errors import UnreadableJobError
from meshdeform.record.database import Database
from meshdeform.record.leases import Leases
from meshdeform.record.models import JobState
from meshdeform.record.rows import OWNED
from meshdeform.record.schema import jobs
from meshdeform.requests.document import JobRequest, read_stored
from meshdeform.runs import kind_of

__all__ = ["Estimate", "estimate"]

_SAMPLES = 50
_COUNTED = 200
"""Maximum number of jobs ahead that are read one by one; for the rest, the mean of these is used."""


@dataclass(frozen=True)
class Estimate:
    """The expected duration of a job, and the data that says so.

    `queue_s` are the seconds until a worker takes the job, None if unknown; `run_s` those from then to its end, None if
    no similar job has succeeded.
    """

    queue_s: float | None
    run_s: float | None
    basis: str


def estimate(
    database: Database, leases: Leases, request: JobRequest, *, default_model: str, queue: str, owner_id: str = ""
) -> Estimate:
    """Estimate a job from the newest successful jobs, the jobs ahead, and the number of live workers.

    The job's owner takes turns with the others; a request that names no model has the default one.
    """
    with database.read() as connection:
        same = jobs.c.workload == request.workload
        step_s, count = _step_seconds(connection, same)
        basis = f"{_jobs(count)} of this kind and model"
        if step_s is None:
            step_s, count = _step_seconds(connection, jobs.c.kind == request.kind.value)
            basis = f"{_jobs(count)} of this kind with other models"
        if step_s is None:
            return Estimate(None, None, "no job of this kind has succeeded here yet")
        ahead = _Ahead.of(connection, request.priority, owner_id, default_model)
    run_s = step_s * kind_of(request.kind).steps(request, default_model, None)
    workers = leases.alive(queue)
    if workers == 0:
        return Estimate(None, run_s, f"{basis}; no worker is alive")
    basis = f"{basis}; {workers} worker{'s' * (workers > 1)} alive"
    return Estimate(ahead.steps_until_free(workers) * step_s, run_s, basis)


def _jobs(count: int) -> str:
    return f"{count} job{'s' * (count > 1)}"


def _step_seconds(connection: sa.Connection, which: sa.ColumnElement[bool]) -> tuple[float | None, int]:
    """Return the median seconds per step of the newest successful jobs, and their number."""
    query = (
        sa.select(jobs.c.step_s)
        .where(which, jobs.c.state == JobState.SUCCEEDED, jobs.c.step_s.is_not(None))
        .order_by(jobs.c.id.desc())
        .limit(_SAMPLES)
    )
    found = list(connection.scalars(query))
    return (statistics.median(found), len(found)) if found else (None, 0)


@dataclass(frozen=True)
class _Ahead:
    """The work before a new job: the steps left of each running job and of each queued job ahead of it."""

    running: list[int]
    queued: list[int]
    more: int

    @classmethod
    def of(cls, connection: sa.Connection, priority: int, owner_id: str, default_model: str) -> Self:
        """Return the work before a new job of this owner: at its own priority, one job of each owner in every turn."""
        queued = jobs.c.state == JobState.QUEUED
        alike = sa.and_(queued, jobs.c.priority == priority)
        own = _count(connection, sa.and_(alike, jobs.c.owner_id == owner_id))
        turn = sa.func.row_number().over(partition_by=jobs.c.owner_id, order_by=jobs.c.id)
        turns = sa.select(jobs.c.id, turn.label("turn")).where(alike).subquery()
        before = sa.select(turns.c.id).where(turns.c.turn <= own + 1)
        urgent, in_turn = sa.and_(queued, jobs.c.priority > priority), sa.and_(alike, jobs.c.id.in_(before))

        def left(which: sa.ColumnElement[bool], limit: int = _COUNTED) -> list[int]:
            query = sa.select(jobs.c.request, jobs.c.resolved, jobs.c.total_steps, jobs.c.step).where(which)
            found = connection.execute(query.order_by(jobs.c.priority.desc(), jobs.c.id).limit(limit)).all()
            return [_steps_left(*row, default_model) for row in found]

        steps = left(urgent)
        steps += left(in_turn, _COUNTED - len(steps))
        total = _count(connection, urgent) + _count(connection, in_turn)
        return cls(left(jobs.c.state.in_(OWNED)), steps, total - len(steps))

    def steps_until_free(self, workers: int) -> float:
        """Return the steps until a worker is free for the new job, if each free worker takes the next job."""
        # There are more running jobs than workers if a worker counts as silent; use the longest jobs.
        free_at = sorted(self.running, reverse=True)[:workers]
        free_at += [0] * (workers - len(free_at))
        heapq.heapify(free_at)
        for steps in self.queued:
            heapq.heapreplace(free_at, free_at[0] + steps)
        return free_at[0] + self.more * (statistics.fmean(self.queued) if self.queued else 0.0) / workers


def _count(connection: sa.Connection, which: sa.ColumnElement[bool]) -> int:
    return connection.execute(sa.select(sa.func.count()).select_from(jobs).where(which)).scalar_one()


def _steps_left(
    document: dict[str, Any], resolved: dict[str, Any] | None, total_steps: int, step: int, default_model: str
) -> int:
    if total_steps:
        return max(0, total_steps - step)
    try:
        request = read_stored(document)
    except UnreadableJobError:
        return 0  # no worker that could tell takes it
    return kind_of(request.kind).steps(request, default_model, resolved)
