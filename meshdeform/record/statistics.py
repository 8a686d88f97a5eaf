"""How many jobs there are and how long they wait, for whoever watches the deployment."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

import sqlalchemy as sa

from meshdeform.record.database import Database
from meshdeform.record.models import JobState
from meshdeform.record.schema import deliveries, jobs

__all__ = ["Statistics", "statistics"]


@dataclass(frozen=True)
class Statistics:
    """A look at the record.

    Attributes
    ----------
    jobs : dict of JobState to int
        Jobs in each state.
    oldest_queued_s : float
        Seconds since the creation of the queued job that was created first; 0 where none is queued.
    pending_deliveries : int
        Messages to webhooks that are not delivered yet.
    """

    jobs: dict[JobState, int]
    oldest_queued_s: float
    pending_deliveries: int


def statistics(database: Database) -> Statistics:
    """Look once; every query is answered from an index."""
    by_state = sa.select(jobs.c.state, sa.func.count()).group_by(jobs.c.state)
    # Ids sort by time.
    oldest = sa.select(jobs.c.created_at).where(jobs.c.state == JobState.QUEUED).order_by(jobs.c.id).limit(1)
    pending = sa.select(sa.func.count()).select_from(deliveries).where(deliveries.c.state == "pending")
    with database.read() as connection:
        counts = {JobState(state): count for state, count in connection.execute(by_state).all()}
        created = connection.execute(oldest).scalar()
        waiting = connection.execute(pending).scalar_one()
    age = (datetime.now(UTC) - created).total_seconds() if created else 0.0
    return Statistics({state: counts.get(state, 0) for state in JobState}, max(0.0, age), waiting)
