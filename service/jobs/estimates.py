"""Estimate how long a job will wait and run, from its mesh and steps and from the other jobs in the record."""

from __future__ import annotations

import heapq
import math
import statistics
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import sqlalchemy as sa

from meshdeform.api.documents import JobEstimate
from meshdeform.errors import UnreadableJobError
from meshdeform.record.database import Database
from meshdeform.record.leases import Leases
from meshdeform.record.models import JobState
from meshdeform.record.rows import OWNED
from meshdeform.record.schema import jobs
from meshdeform.record.turns import Turns
from meshdeform.requests.choices import is_builtin
from meshdeform.requests.document import JobRequest, read_stored
from meshdeform.runs import kind_of
from meshdeform.runs.costs import END_SHARE, Costs, Seconds, costs_of, pace_of

_SAMPLES = 50
_COUNTED, _NUMBERED = 200, 2_000
"""How many jobs ahead are read one by one, found among so many of the oldest; the others take the mean of these."""

_Work = tuple[str, float]
_Row = sa.Row[*tuple[Any, ...]]
_SAFEGUARD = jobs.c.resolved["safeguard"].as_string().label("safeguard")
_NO_TURNS = Turns(turn_s=math.inf)
_COSTS = (jobs.c.workload, jobs.c.faces, jobs.c.parts, _SAFEGUARD)


@dataclass(frozen=True)
class JobSize:
    """What is known of a job's mesh, which its time depends on, and of its safeguard."""

    faces: int | None = None
    meshes: int | None = None
    safeguard: str | None = None


_UNKNOWN = JobSize()


def estimate(
    database: Database,
    leases: Leases,
    request: JobRequest,
    *,
    default_model: str,
    queue: str,
    owner_id: str = "",
    size: JobSize = _UNKNOWN,
    turns: Turns = _NO_TURNS,
) -> JobEstimate:
    """Estimate a job from its mesh, the newest successful jobs, the jobs ahead, and the number of live workers.

    `turns`: those that the job's owner takes with the others. A request that names no model has the default one.
    """
    steps = kind_of(request.kind).steps(request, default_model, None)
    with database.read() as connection:
        history = _History(connection, default_model)
        pace, basis = history.pace(request.kind, request.workload)
        if pace is None:
            return JobEstimate(basis=basis, steps=steps)
        seconds = costs_of(request.workload).seconds(size.faces, size.meshes, size.safeguard).times(pace)
        run_s = seconds.of(steps)

        def seconds_left(row: _Row) -> float:
            left_s: float = history.seconds_left(row, run_s)
            return left_s if row.owner_id == owner_id else min(left_s, turns.turn_s)

        ahead = _Ahead.of(connection, request.priority, owner_id, seconds_left)
    workers = leases.alive(queue)
    alive = f"{workers} worker{'s' * (workers > 1)}" if workers else "no worker is"
    return JobEstimate(
        queue_s=ahead.seconds_until_free(workers, owner_id, turns.max_running) if workers else None,
        run_s=run_s,
        not_resumable_s=seconds.once,
        basis=f"{basis}; {alive} alive",
        steps=steps,
    )


class _History:
    """How long jobs took here, compared with their costs."""

    def __init__(self, connection: sa.Connection, default_model: str) -> None:
        self._connection, self._default_model = connection, default_model
        self._paces: dict[str, tuple[Seconds | None, str]] = {}

    def pace(self, kind: str, workload: str) -> tuple[Seconds | None, str]:
        """Return the pace of a workload, None if nothing is known of it, and what that is based on."""
        if workload not in self._paces:
            self._paces[workload] = self._pace(kind, workload)
        return self._paces[workload]

    def _pace(self, kind: str, workload: str) -> tuple[Seconds | None, str]:
        for alike, words in ((jobs.c.workload == workload, "and model"), (jobs.c.kind == kind, "with other models")):
            if measured := self._measured(alike):
                count = len(measured)
                return pace_of(measured), f"{count} job{'s' * (count > 1)} of this kind {words}"
        basis = "no job of this kind has succeeded here yet"
        # Costs were measured with the builtin model.
        if costs_of(workload) == Costs() or not is_builtin(workload.split("/")[2] or self._default_model):
            return None, basis
        return Seconds(1.0, 1.0), f"{basis}: a rough figure, by the pace of another machine"

    def _measured(self, alike: sa.ColumnElement[bool]) -> list[tuple[Seconds, Seconds]]:
        """Return the expected and the actual seconds of the newest successful jobs."""
        times = (jobs.c.step_s, jobs.c.total_steps, jobs.c.ran_s, jobs.c.started_at, jobs.c.finished_at)
        done = sa.and_(jobs.c.state == JobState.SUCCEEDED, jobs.c.step_s.is_not(None), jobs.c.origin.is_(None))
        query = sa.select(*_COSTS, *times).where(alike, done)
        rows = self._connection.execute(query.order_by(jobs.c.id.desc()).limit(_SAMPLES)).all()
        return [(_expected(row), _taken(row)) for row in rows]

    def seconds_left(self, row: _Row, unknown_s: float) -> float:
        """Return the seconds until an unfinished job ends; those of a whole job if nothing is known of its kind."""
        pace, _ = self.pace(row.kind, row.workload)
        if pace is None:
            return unknown_s
        seconds = _expected(row).times(pace)
        steps: int = row.total_steps - row.step
        if row.step:
            return END_SHARE * seconds.once + max(0, steps) * seconds.step
        try:
            request = read_stored(row.request)
        except UnreadableJobError:
            return 0.0  # no worker that could tell takes it
        steps = kind_of(request.kind).steps(request, self._default_model, row.resolved)
        return seconds.of(steps)


def _expected(row: _Row) -> Seconds:
    return costs_of(row.workload).seconds(row.faces, row.parts, row.safeguard)


def _taken(row: _Row) -> Seconds:
    """Return the seconds that a job took, without the time between its attempts where that is known."""
    ran_s = row.ran_s or (row.finished_at - row.started_at).total_seconds()
    return Seconds(max(0.0, ran_s - row.total_steps * row.step_s), row.step_s)


@dataclass(frozen=True)
class _Ahead:
    """The work before a new job: the owner and the seconds left of each running job and each queued one ahead of it."""

    running: list[_Work]
    queued: list[_Work]
    more: int

    @classmethod
    def of(cls, connection: sa.Connection, priority: int, owner_id: str, seconds_left: Callable[[_Row], float]) -> Self:
        """Return the work before a new job of this owner: at its own priority, one job of each owner in every turn."""
        queued = jobs.c.state == JobState.QUEUED
        alike = sa.and_(queued, jobs.c.priority == priority)
        numbers = sa.select(jobs.c.owner_id, sa.func.count()).where(alike).group_by(jobs.c.owner_id)
        waiting: dict[str, int] = {row[0]: row[1] for row in connection.execute(numbers)}
        own = waiting.get(owner_id, 0)
        # Of the oldest alone: a number for every job that waits takes as long as there are jobs.
        oldest = sa.select(jobs.c.id, jobs.c.owner_id).where(alike).order_by(jobs.c.id).limit(_NUMBERED).subquery()
        turn = sa.func.row_number().over(partition_by=oldest.c.owner_id, order_by=oldest.c.id)
        turns = sa.select(oldest.c.id, turn.label("turn")).subquery()
        before = sa.select(turns.c.id).where(turns.c.turn <= own + 1)
        urgent, in_turn = sa.and_(queued, jobs.c.priority > priority), sa.and_(alike, jobs.c.id.in_(before))
        about = (jobs.c.kind, jobs.c.owner_id, jobs.c.request, jobs.c.resolved, jobs.c.total_steps, jobs.c.step)

        def left(which: sa.ColumnElement[bool], limit: int = _COUNTED) -> list[_Work]:
            query = sa.select(*_COSTS, *about).where(which).order_by(jobs.c.priority.desc(), jobs.c.id).limit(limit)
            return [(row.owner_id, seconds_left(row)) for row in connection.execute(query).all()]

        seconds = left(urgent)
        seconds += left(in_turn, _COUNTED - len(seconds))
        total = _count(connection, urgent) + sum(min(number, own + 1) for number in waiting.values())
        return cls(left(jobs.c.state.in_(OWNED)), seconds, total - len(seconds))

    def seconds_until_free(self, workers: int, owner_id: str = "", max_running: int = 0) -> float:
        """Return the seconds until a worker takes the new job, if each free worker takes the next job that may start.

        `max_running`: how many jobs of one owner run at the same time; 0: any number.
        """
        # There are more running jobs than workers if a worker counts as silent; use the longest jobs.
        longest = sorted(self.running, key=lambda work: work[1], reverse=True)[:workers]
        ends = [(seconds, owner) for owner, seconds in longest]
        heapq.heapify(ends)
        busy = Counter(owner for owner, _ in longest)
        waiting: list[tuple[str, float | None]] = [*self.queued, (owner_id, None)]
        now = 0.0
        while True:
            may_start = (at for at, (owner, _) in enumerate(waiting) if not max_running or busy[owner] < max_running)
            if len(ends) == workers or (at := next(may_start, None)) is None:
                now, owner = heapq.heappop(ends)
                busy[owner] -= 1
                continue
            owner, seconds = waiting.pop(at)
            if seconds is None:
                break
            heapq.heappush(ends, (now + seconds, owner))
            busy[owner] += 1
        mean_s = statistics.fmean(seconds for _, seconds in self.queued) if self.queued else 0.0
        return now + self.more * mean_s / workers


def _count(connection: sa.Connection, which: sa.ColumnElement[bool]) -> int:
    return connection.execute(sa.select(sa.func.count()).select_from(jobs).where(which)).scalar_one()
