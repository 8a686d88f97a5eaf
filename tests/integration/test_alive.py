"""Which workers are alive, on SQLite and PostgreSQL."""

from __future__ import annotations

import pytest
import sqlalchemy as sa

from meshdeform.errors import StaleAttemptError
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import workers
from tests.integration.record_calls import LEASE_S, claimed, posted


def silent_for(record: JobRecord, worker_id: str, seconds: float) -> None:
    with record.database.write() as connection:
        change = sa.update(workers).where(workers.c.id == worker_id)
        connection.execute(change.values(seen_at=record.database.now(-seconds)))


def known(record: JobRecord) -> dict[str, str]:
    with record.database.read() as connection:
        return {row.id: row.device for row in connection.execute(sa.select(workers))}


def test_workers_count_in_their_queue_for_as_long_as_they_say_so(record: JobRecord) -> None:
    for worker_id, queue in (("a", "one"), ("b", "one"), ("c", "other")):
        record.leases.idle(WorkerIdentity(worker_id, queue, "cpu"))
    record.leases.idle(WorkerIdentity("a", "one", "cuda:0"))  # again: it is still one worker
    assert [record.leases.alive(queue) for queue in ("one", "other", "none")] == [2, 1, 0]
    assert known(record)["a"] == "cuda:0"
    silent_for(record, "b", 60.0)
    assert record.leases.alive("one") == 1
    record.leases.idle(WorkerIdentity("b", "one", "cpu"))
    assert record.leases.alive("one") == 2
    record.leases.worker_ended("b")
    assert record.leases.alive("one") == 1


def test_who_fell_silent_a_day_ago_is_forgotten(record: JobRecord) -> None:
    for worker_id in ("old", "silent", "alive", "ending"):
        record.leases.idle(WorkerIdentity(worker_id, "one", "cpu"))
    silent_for(record, "old", 86_500.0)
    silent_for(record, "silent", 80_000.0)
    record.leases.worker_ended("ending")
    assert set(known(record)) == {"silent", "alive"}


def test_the_lease_of_a_job_keeps_its_worker_alive(record: JobRecord) -> None:
    worker = WorkerIdentity("busy", "one", "cpu")
    job = claimed(record, posted(record))
    record.leases.heartbeat(job.id, 1, LEASE_S, worker=worker)
    assert record.leases.alive("one") == 1
    silent_for(record, "busy", 60.0)
    assert record.leases.alive("one") == 0
    record.leases.heartbeat(job.id, 1, LEASE_S, worker=worker)
    assert record.leases.alive("one") == 1
    silent_for(record, "busy", 60.0)
    with pytest.raises(StaleAttemptError):
        record.leases.heartbeat(job.id, 2, LEASE_S, worker=worker)
    assert record.leases.alive("one") == 0
