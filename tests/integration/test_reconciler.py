"""What mends the queue when Redis forgets, workers fall silent or the store is away, on a real Redis."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path

import pytest
import redis

from meshdeform.errors import UnavailableError
from meshdeform.record import reconciler as module
from meshdeform.record.models import JobState
from meshdeform.record.queue import JobQueue
from meshdeform.record.reconciler import Reconciler
from meshdeform.record.repository import JobRecord
from meshdeform.record.upkeep import Watch
from meshdeform.storage import ObjectStore
from meshdeform.storage.readings import StoredReadings
from tests.integration.conftest import DEADLINE_S, new_job
from tests.integration.record_calls import LEASE_S, OVER, claimed, ids, late, posted, set_to
from tests.servers import free_port
from tests.waiting import until


@pytest.fixture
def queue(redis_url: str) -> Iterator[JobQueue]:
    opened = JobQueue(redis_url, "test")
    yield opened
    opened.close()


def reconciler(record: JobRecord, queue: JobQueue, store: ObjectStore | None = None) -> Reconciler:
    return Reconciler(record, queue, 3, LEASE_S, store=store)


def watching(record: JobRecord, queue: JobQueue, store: ObjectStore | None = None) -> Reconciler:
    """A reconciler that has watched the leases for as long as one lasts."""
    looks = reconciler(record, queue, store)
    now = record.upkeep.clock()
    looks._watch.now, looks._watch.since = now, now - timedelta(seconds=2 * LEASE_S)
    return looks


class Paused:
    """What is done in the moment in which a reconciler pauses before it counts again."""

    def __init__(self, do: Callable[[], object]) -> None:
        self._do = do

    def wait(self, seconds: float) -> None:
        """Do it at once."""
        assert seconds > 0
        self._do()


@pytest.mark.both_databases
def test_who_is_not_told_yet_is_told_once(record: JobRecord, queue: JobQueue) -> None:
    jobs = [new_job(record) for _ in range(3)]
    queue.enqueue(jobs[1].id)
    assert reconciler(record, queue).run_once() == [jobs[0].id, jobs[2].id]
    assert reconciler(record, queue).run_once() == []
    assert queue.length() == 3


def test_what_redis_forgot_is_told_again_and_only_that(record: JobRecord, queue: JobQueue, redis_url: str) -> None:
    jobs = [new_job(record) for _ in range(4)]
    for job in jobs:
        queue.enqueue(job.id)
    claimed(record, jobs[0])
    looks = reconciler(record, queue)
    assert looks.run_once() == []
    with redis.Redis.from_url(redis_url) as connection:
        connection.flushall()
    queue.enqueue(jobs[2].id)
    assert looks.run_once() == [jobs[1].id, jobs[3].id]
    assert looks.run_once() == []
    assert queue.announced() == {job.id for job in jobs[1:]}
    assert queue.length() == 3


def test_there_are_never_fewer_messages_than_queued_jobs_whichever_job_a_worker_takes(
    record: JobRecord, queue: JobQueue, redis_url: str
) -> None:
    jobs = [posted(record, priority=number) for number in range(6)]
    looks = reconciler(record, queue)
    looks.run_once()
    with redis.Redis.from_url(redis_url) as connection:
        for _ in range(2):
            # A worker hears of any job and takes the most urgent one.
            connection.lpop("rq:queue:test")
            taken = record.leases.claim_next("worker", LEASE_S)
            assert taken is not None
        assert looks.run_once() == []
        connection.lpop("rq:queue:test", 3)
    assert len(looks.run_once()) >= 3
    assert queue.length() >= record.upkeep.queued_count(9) == len(jobs) - 2


def test_of_very_many_only_as_many_are_told_as_are_needed_soon(
    record: JobRecord, queue: JobQueue, redis_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_ENOUGH", 3)
    jobs, looks = [posted(record) for _ in range(8)], reconciler(record, queue)
    assert looks.run_once() == ids(jobs[:3])
    assert looks.run_once() == []
    with redis.Redis.from_url(redis_url) as connection:
        for _ in range(2):
            connection.lpop("rq:queue:test")
            record.leases.claim_next("worker", LEASE_S)
    assert looks.run_once() == ids(jobs[3:5])


def test_a_job_whose_worker_fell_silent_is_told_again(record: JobRecord, queue: JobQueue) -> None:
    job = claimed(record, new_job(record), OVER)
    assert watching(record, queue).run_once() == [job.id]
    assert record.get(job.id).state is JobState.QUEUED


def test_a_worker_between_its_message_and_its_claim_is_no_lost_message(record: JobRecord, queue: JobQueue) -> None:
    job, looks = new_job(record), reconciler(record, queue)
    looks._done = Paused(lambda: claimed(record, job))  # type: ignore[assignment]
    assert looks.run_once() == []
    assert queue.length() == 0


@pytest.mark.both_databases
def test_after_a_pause_or_a_jump_of_the_clock_a_worker_renews_its_lease_before_anybody_reclaims(
    record: JobRecord, queue: JobQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = claimed(record, new_job(record))
    clock, ahead = record.upkeep.clock, timedelta(0)
    monkeypatch.setattr(record.upkeep, "clock", lambda: clock() + ahead)
    monkeypatch.setattr(record.upkeep, "shorten_leases", lambda _: 0)  # it goes by the real clock
    reconcilers = [watching(record, queue) for _ in range(2)]
    for hour in range(1, 5):
        ahead = timedelta(hours=hour)
        for looks in reconcilers:
            looks.run_once()
            assert record.get(job.id).state is JobState.RUNNING
        # The worker renews its lease, by the same clock.
        set_to(record, job, lease_expires_at=clock() + ahead + timedelta(seconds=LEASE_S))
    for looks in reconcilers:
        looks.run_once()
    assert record.get(job.id).attempt == 1


@pytest.mark.both_databases
def test_who_dies_with_the_whole_machine_is_taken_back_after_one_lease_and_not_blamed(
    record: JobRecord, queue: JobQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = new_job(record)
    clock, ahead = record.upkeep.clock, timedelta(0)
    monkeypatch.setattr(record.upkeep, "clock", lambda: clock() + ahead)
    monkeypatch.setattr(record.upkeep, "shorten_leases", lambda _: 0)  # it goes by the real clock
    for _ in range(4):
        claimed(record, job)
        ahead += timedelta(hours=1)
        looks = reconciler(record, queue)
        looks.run_once()
        assert record.get(job.id).state is JobState.RUNNING
        for _ in range(3):
            ahead += timedelta(seconds=LEASE_S / 2)
            looks.run_once()
        assert record.get(job.id).state is JobState.QUEUED
    assert record.events.after(job.id)[-1].data == {"lost_attempts": 0}
    # One whose neighbours live is blamed: its supervisor says so, or it had renewed its lease before their eyes.
    claimed(record, job)
    record.leases.worker_ended("worker")
    looks.run_once()
    assert record.events.after(job.id)[-1].data == {"lost_attempts": 1}
    set_to(record, claimed(record, job), lease_expires_at=clock() + ahead)
    ahead += timedelta(seconds=1)
    looks.run_once()
    assert record.events.after(job.id)[-1].data == {"lost_attempts": 2}


def test_a_job_that_brings_down_its_machine_each_time_fails_at_last(record: JobRecord) -> None:
    job, now = new_job(record), record.upkeep.clock()
    watch = Watch(LEASE_S, 5.0, now=now, since=now)
    watch.since = now + timedelta(hours=1)  # nothing is blamed on it
    watch.now = now + timedelta(hours=2)
    for _ in range(2 * 10 - 1):
        claimed(record, job, OVER)
        assert record.upkeep.reclaim_expired(2, watch) == [job.id]
    claimed(record, job, OVER)
    assert record.upkeep.reclaim_expired(2, watch) == []
    assert record.get(job.id).state is JobState.FAILED


def test_a_lease_of_a_clock_that_was_set_back_does_not_last(record: JobRecord, queue: JobQueue) -> None:
    job = claimed(record, new_job(record), 86_400.0)
    usual = claimed(record, new_job(record), LEASE_S)
    reconciler(record, queue).run_once()
    assert record.upkeep.shorten_leases(LEASE_S / 2 + 1.0) == 0
    assert {record.get(each.id).state for each in (job, usual)} == {JobState.RUNNING}


def test_the_worker_of_a_job_whose_deadline_is_over_is_told_to_stop(record: JobRecord, queue: JobQueue) -> None:
    running, queued = claimed(record, late(record)), late(record)
    with queue.listen_for_cancel(running.id) as mine, queue.listen_for_cancel(queued.id) as nobodys:
        assert not mine.wait(0.05)  # subscribed from here on
        assert not nobodys.wait(0.05)
        assert reconciler(record, queue).run_once() == []
        assert mine.wait(DEADLINE_S)
        assert not nobodys.wait(0.05)
    assert {record.get(job.id).state for job in (running, queued)} == {JobState.EXPIRED}


def test_one_duty_that_fails_does_not_stop_the_others(
    record: JobRecord, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = ObjectStore(tmp_path)
    lost = claimed(record, new_job(record), OVER)
    overdue = claimed(record, late(record))
    over = record.request_cancel(posted(record, retention_s=60.0).id)
    set_to(record, over, retain_until=record.database.now(-1.0))
    store.put(f"jobs/{over.id}/1/result.glb", b"result")
    nowhere = JobQueue(f"redis://127.0.0.1:{free_port()}/0", "test")
    with caplog.at_level(logging.WARNING):
        assert watching(record, nowhere, store).run_once() == []
    nowhere.close()
    assert "Redis" in caplog.text
    assert record.get(lost.id).state is JobState.QUEUED
    assert record.get(overdue.id).state is JobState.EXPIRED
    assert ids(record.list_jobs(JobState.CANCELED).jobs) == []
    assert list(store.list("jobs/")) == []


def test_a_store_that_is_away_keeps_nobody_from_being_told(record: JobRecord, queue: JobQueue, tmp_path: Path) -> None:
    store = ObjectStore(tmp_path)
    gone = record.request_cancel(new_job(record).id)
    record.delete(gone.id)
    job = new_job(record)

    def away(prefix: str) -> None:
        raise UnavailableError("away")

    store.delete_prefix = away  # type: ignore[method-assign]
    assert reconciler(record, queue, store).run_once() == [job.id]
    assert record.upkeep.discarded_prefixes() == [f"jobs/{gone.id}/"]


def test_old_readings_are_removed_now_and_then(
    record: JobRecord, queue: JobQueue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = ObjectStore(tmp_path)
    store.put("readings/1/abc", b"of 1970")
    StoredReadings(store).put("def", b"new")
    doing = reconciler(record, queue, store)

    def away(_prefix: str) -> None:
        raise UnavailableError("away")

    with monkeypatch.context() as patch:
        patch.setattr(store, "delete_prefix", away)
        doing.run_once()
    doing.run_once()
    ((kept, _),) = store.list("readings/")
    assert kept.endswith("/def")
    store.put("readings/1/abc", b"of 1970")
    doing.run_once()  # too soon to list them again
    assert store.exists("readings/1/abc")


@pytest.mark.both_databases
def test_the_reconciler_lives_through_an_outage(record: JobRecord, redis_url: str) -> None:
    job = new_job(record)
    queue = JobQueue(redis_url, "test")
    enqueue, failures = queue.enqueue, iter([UnavailableError("away"), RuntimeError("a mistake")])

    def flaky(job_id: str) -> None:
        if error := next(failures, None):
            raise error
        enqueue(job_id)

    queue.enqueue = flaky  # type: ignore[method-assign]
    with Reconciler(record, queue, 3, LEASE_S, every_s=0.01):
        until(lambda: job.id in queue.announced())
    queue.close()
