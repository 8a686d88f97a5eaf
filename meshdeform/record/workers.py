"""Which workers are alive, as their supervisors say. Nothing depends on it but estimates and metrics."""

from __future__ import annotations

import sqlalchemy as sa

from meshdeform.record.database import Database
from meshdeform.record.schema import workers

__all__ = ["WorkerRegistry"]

_ALIVE_S = 30.0
_KEPT_S = 86_400.0


class WorkerRegistry:
    """One row for each worker process."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def seen(self, worker_id: str, queue: str, device: str) -> None:
        """Say that a worker is alive; to be repeated every few seconds."""
        now = self._database.now()
        insert = self._database.upsert(workers).values(
            id=worker_id, queue=queue, device=device, started_at=now, seen_at=now
        )
        insert = insert.on_conflict_do_update(index_elements=["id"], set_={"seen_at": now, "device": device})
        with self._database.write() as connection:
            connection.execute(insert)

    def gone(self, worker_id: str) -> None:
        """Say that a worker has ended, and forget those that fell silent a day ago."""
        old = workers.c.seen_at < self._database.now(-_KEPT_S)
        with self._database.write() as connection:
            connection.execute(sa.delete(workers).where(sa.or_(workers.c.id == worker_id, old)))

    def alive(self, queue: str) -> int:
        """Return how many workers of a queue are alive."""
        seen = sa.and_(workers.c.queue == queue, workers.c.seen_at > self._database.now(-_ALIVE_S))
        with self._database.read() as connection:
            return connection.execute(sa.select(sa.func.count()).select_from(workers).where(seen)).scalar_one()
