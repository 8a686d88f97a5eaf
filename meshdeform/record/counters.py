"""Numbers for the metrics: counters and histograms that outlive processes, and the current number of jobs."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise

import sqlalchemy as sa

from meshdeform.record.database import Database
from meshdeform.record.models import TERMINAL_STATES, JobState
from meshdeform.record.schema import deliveries, jobs, tallies

BUCKETS_S: dict[str, tuple[float, ...]] = {
    "job_seconds": (1.0, 5.0, 15.0, 30.0, 60.0, 120.0, 300.0, 900.0, 3600.0, 14400.0),
    "queue_wait_seconds": (0.1, 0.5, 1.0, 5.0, 15.0, 60.0, 300.0, 900.0, 3600.0),
    "step_seconds": (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 5.0, 30.0),
}
"""Upper bounds of the histograms in seconds; larger values count as `inf`."""


class Counters:
    """The increments of one transaction, written at its end in a fixed order, so that transactions cannot deadlock."""

    def __init__(self, database: Database, connection: sa.Connection) -> None:
        self._database, self._connection = database, connection
        self._sums: Counter[tuple[str, str]] = Counter()

    def add(self, name: str, label: str = "", value: float = 1.0) -> None:
        """Add to a counter."""
        self._sums[name, label] += value  # type: ignore[assignment]

    def observe(self, name: str, seconds: float) -> None:
        """Add a value to a histogram of `BUCKETS_S`. Negative durations, from clocks set back, count as 0."""
        seconds = max(0.0, seconds)
        bucket = next((f"{bound:g}" for bound in BUCKETS_S[name] if seconds <= bound), "inf")
        self.add(f"{name}_bucket", bucket)
        self.add(f"{name}_sum", value=seconds)

    def write(self) -> None:
        """Write all increments."""
        for (name, label), value in sorted(self._sums.items()):
            insert = self._database.upsert(tallies).values(name=name, label=label, value=value)
            more = {"value": tallies.c.value + insert.excluded.value}
            self._connection.execute(insert.on_conflict_do_update(index_elements=["name", "label"], set_=more))


def read_counters(database: Database) -> dict[tuple[str, str], float]:
    """Return every counter by name and label."""
    with database.read() as connection:
        return {(row.name, row.label): row.value for row in connection.execute(sa.select(tallies))}


@dataclass(frozen=True)
class Statistics:
    """Current numbers of the record: unfinished jobs by state; `oldest_queued_s` is 0 if no job is queued."""

    jobs: dict[JobState, int]
    oldest_queued_s: float
    pending_deliveries: int


def statistics(database: Database) -> Statistics:
    """Return the current numbers; every query uses an index, and none counts the jobs that have ended."""
    unfinished = [state for state in JobState if state not in TERMINAL_STATES]
    going = sa.select(jobs.c.state, sa.func.count()).where(jobs.c.state.in_(unfinished))
    # Ids sort by time.
    oldest = sa.select(jobs.c.created_at).where(jobs.c.state == JobState.QUEUED).order_by(jobs.c.id).limit(1)
    pending = sa.select(sa.func.count()).select_from(deliveries).where(deliveries.c.state == "pending")
    with database.read() as connection:
        counts = {JobState(state): count for state, count in connection.execute(going.group_by(jobs.c.state)).all()}
        created = connection.execute(oldest).scalar()
        waiting = connection.execute(pending).scalar_one()
    age = (datetime.now(UTC) - created).total_seconds() if created else 0.0
    return Statistics({state: counts.get(state, 0) for state in unfinished}, max(0.0, age), waiting)


assert all(low < high for bounds in BUCKETS_S.values() for low, high in pairwise(bounds))
