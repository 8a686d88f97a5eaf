"""Which workers are alive."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import sqlalchemy as sa

from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import workers


def silent_for(record: JobRecord, worker_id: str, seconds: float) -> None:
    with record.database.write() as connection:
        change = sa.update(workers).where(workers.c.id == worker_id)
        connection.execute(change.values(seen_at=record.database.now(-seconds)))


def known(record: JobRecord) -> dict[str, str]:
    with record.database.read() as connection:
        return {row.id: row.device for row in connection.execute(sa.select(workers))}


def test_workers_count_in_their_queue_for_as_long_as_they_say_so(record: JobRecord) -> None:
    for worker_id, queue in (("a", "one"), ("b", "one"), ("c", "other")):
        record.registry.seen(worker_id, queue, "cpu")
    record.registry.seen("a", "one", "cuda:0")  # again: it is still one worker
    assert [record.registry.alive(queue) for queue in ("one", "other", "none")] == [2, 1, 0]
    assert known(record)["a"] == "cuda:0"
    silent_for(record, "b", 60.0)
    assert record.registry.alive("one") == 1
    record.registry.seen("b", "one", "cpu")
    assert record.registry.alive("one") == 2
    record.registry.gone("b")
    assert record.registry.alive("one") == 1


def test_who_fell_silent_a_day_ago_is_forgotten(record: JobRecord) -> None:
    for worker_id in ("old", "silent", "alive", "ending"):
        record.registry.seen(worker_id, "one", "cpu")
    silent_for(record, "old", 86_500.0)
    silent_for(record, "silent", 80_000.0)
    record.registry.gone("ending")
    assert set(known(record)) == {"silent", "alive"}


def test_many_say_so_at_once(record: JobRecord) -> None:
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda number: record.registry.seen(f"worker{number % 4}", "one", "cpu"), range(40)))
    assert record.registry.alive("one") == 4
