"""What owners have used, by month. Written in the transaction that ends an attempt or a job, or publishes a result.

So a worker that is killed, a write that is sent again and an attempt that has lost its job can count nothing twice and
lose nothing: where the change is refused or rolled back, so is its count.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, fields
from datetime import datetime

import sqlalchemy as sa

from meshdeform.record.database import Database
from meshdeform.record.rows import read
from meshdeform.record.schema import usage


@dataclass
class Used:
    """What was used: jobs that ended, seconds for which workers had jobs, and bytes of artifacts."""

    jobs: int = 0
    seconds: float = 0.0
    bytes: int = 0


@dataclass(frozen=True)
class MonthOfOwner:
    """What an owner has used in a month of UTC, such as `2026-11`. The owner is empty if keys are off."""

    owner_id: str
    month: str
    jobs: int
    seconds: float
    bytes: int


class UsageCounts:
    """The increments of one transaction, written at its end in a fixed order, so that transactions cannot deadlock."""

    def __init__(self, database: Database, connection: sa.Connection) -> None:
        self._database, self._connection = database, connection
        self._sums: defaultdict[str, Used] = defaultdict(Used)

    def add(self, owner_id: str, *, jobs: int = 0, seconds: float = 0.0, size: int = 0) -> None:
        """Add to what an owner has used this month."""
        used = self._sums[owner_id]
        used.jobs += jobs
        used.seconds += seconds
        used.bytes += size

    def write(self) -> None:
        """Write all increments."""
        for owner_id, used in sorted(self._sums.items()):
            amounts = {each.name: getattr(used, each.name) for each in fields(used)}
            month = _month(self._database)
            insert = self._database.upsert(usage).values(owner_id=owner_id, month=month, **amounts)
            more = {name: usage.c[name] + insert.excluded[name] for name in amounts}
            self._connection.execute(insert.on_conflict_do_update(index_elements=["owner_id", "month"], set_=more))


class UsageLedger:
    """What owners have used, for reading."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def months(self, owner: str | None = None) -> list[MonthOfOwner]:
        """Return the months of one owner or of all, newest first.

        Attempts that still run are counted when they end.
        """
        query = sa.select(usage).order_by(usage.c.month.desc(), usage.c.owner_id)
        if owner is not None:
            query = query.where(usage.c.owner_id == owner)
        with self._database.read() as connection:
            return [read(MonthOfOwner, row) for row in connection.execute(query)]


def _month(database: Database) -> str | sa.ColumnElement[str]:
    now = database.now()
    if isinstance(now, datetime):
        return f"{now:%Y-%m}"
    return sa.func.to_char(sa.func.timezone("UTC", now), "YYYY-MM")
