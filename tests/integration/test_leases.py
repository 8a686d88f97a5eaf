"""Workers and jobs, on SQLite and PostgreSQL: one worker has a job, and one that has lost it writes nothing more."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
import sqlalchemy as sa

from meshdeform.errors import StaleAttemptError, StoredFileError
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.models import EventType, JobError, JobState
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import jobs as jobs_table
from meshdeform.record.schema import workers
from tests.claims import claim_job
from tests.integration.conftest import new_job
from tests.integration.record_calls import LEASE_S, OVER, artifact, at, claimed, ids, posted

pytestmark = pytest.mark.both_databases


def test_a_released_job_waits_with_its_checkpoint_and_does_not_count_as_lost(record: JobRecord) -> None:
    job = new_job(record)
    for attempt in range(1, 6):
        claimed(record, job)
        record.leases.set_checkpoint(job.id, attempt, key=f"k{attempt}", step=10 * attempt, sha256="s")
        record.leases.release(job.id, attempt)
        assert record.get(job.id).state is JobState.QUEUED
    checkpoint = record.leases.checkpoints(job.id)[0]
    assert (checkpoint.key, checkpoint.step, checkpoint.attempt) == ("k5", 50, 5)
    claimed(record, job, OVER)
    assert record.upkeep.reclaim_expired(2) == [job.id]


def test_new_progress_forgives_lost_attempts_and_the_same_progress_again_does_not(record: JobRecord) -> None:
    job = new_job(record)
    for attempt in range(1, 6):
        claimed(record, job, OVER)
        record.leases.set_checkpoint(job.id, attempt, key=f"k{attempt}", step=10 * attempt, sha256="s")
        assert record.upkeep.reclaim_expired(2) == [job.id]
    claimed(record, job, OVER)
    # Its checkpoints were damaged, and it dies where it died before.
    record.leases.forget_checkpoint(job.id, 6, "k5")
    record.leases.set_checkpoint(job.id, 6, key="k6", step=50, sha256="s")
    assert record.upkeep.reclaim_expired(2) == []
    assert record.get(job.id).state is JobState.FAILED


def test_a_worker_that_is_known_to_be_gone_loses_its_job_at_once_and_no_other_does(record: JobRecord) -> None:
    lost, kept = new_job(record), new_job(record)
    held = claim_job(record.leases, lost.id, "gone", LEASE_S)
    assert held is not None
    claim_job(record.leases, kept.id, "alive", LEASE_S)
    assert record.leases.worker_ended("gone")
    assert not record.leases.worker_ended("gone")
    for taken_back in (False, True):  # a heartbeat renews nothing before it either
        if taken_back:
            assert record.upkeep.reclaim_expired(2) == [lost.id]
        with pytest.raises(StaleAttemptError):
            record.leases.heartbeat(lost.id, held.attempt, LEASE_S)
    assert (record.get(lost.id).state, record.get(kept.id).state) == (JobState.QUEUED, JobState.RUNNING)
    # It counts as a lost attempt.
    claim_job(record.leases, lost.id, "gone too", LEASE_S)
    assert record.leases.worker_ended("gone too")
    assert record.upkeep.reclaim_expired(2) == []
    assert record.get(lost.id).state is JobState.FAILED


def test_the_newest_checkpoint_comes_first(record: JobRecord) -> None:
    job = claimed(record, new_job(record))
    assert record.leases.checkpoints(job.id) == []
    for step in (100, 200, 300):
        record.leases.set_checkpoint(job.id, 1, key=f"k{step}", step=step, sha256="s")
    record.leases.set_checkpoint(job.id, 1, key="k300", step=300, sha256="again")
    assert [(found.step, found.sha256) for found in record.leases.checkpoints(job.id)] == [
        (300, "again"), (200, "s"), (100, "s"),
    ]  # fmt: skip
    record.leases.forget_checkpoint(job.id, 1, "k100")
    record.leases.release(job.id, 1)
    claimed(record, job)
    record.leases.set_checkpoint(job.id, 2, key="later", step=250, sha256="s")
    assert [found.step for found in record.leases.checkpoints(job.id)] == [250, 300, 200]


def test_an_attempt_that_is_over_writes_nothing(record: JobRecord) -> None:
    old = claimed(record, new_job(record), OVER)
    assert record.leases.heartbeat(old.id, 1, LEASE_S) is JobState.RUNNING
    assert record.upkeep.reclaim_expired(3) == []  # a heartbeat keeps the lease
    record.leases.heartbeat(old.id, 1, OVER)
    # Whoever has not taken it back yet does not give it away either.
    assert claim_job(record.leases, old.id, "another", LEASE_S) is None
    assert record.upkeep.reclaim_expired(3) == [old.id]
    new = claimed(record, old)
    assert (new.attempt, new.started_at) == (2, old.started_at)
    writes: list[Callable[[], object]] = [
        lambda: record.leases.heartbeat(old.id, 1, LEASE_S),
        lambda: record.leases.save_progress(old.id, 1, at(9)),
        lambda: record.leases.set_checkpoint(old.id, 1, key="k", step=1, sha256="s"),
        lambda: record.leases.forget_checkpoint(old.id, 1, key="k"),
        lambda: record.leases.finish(old.id, 1, JobState.SUCCEEDED, results=[artifact()]),
        lambda: record.leases.release(old.id, 1),
        lambda: record.leases.out_of_memory(old.id, 1, 3),
    ]
    for write in writes:
        with pytest.raises(StaleAttemptError):
            write()
    assert record.get(old.id) == new
    assert record.leases.checkpoints(old.id) == []
    assert record.artifacts(old.id) == []
    assert len(record.events.after(old.id)) == new.event_seq


def test_owners_take_turns_within_a_priority(record: JobRecord) -> None:
    busy = [posted(record, "busy") for _ in range(4)]
    one, other = posted(record, "one"), [posted(record, "other") for _ in range(2)]
    urgent = posted(record, "busy", priority=1)
    taken = [record.leases.claim_next("worker", LEASE_S) for _ in range(8)]
    expected = [urgent, one, other[0], busy[0], other[1], busy[1], busy[2], busy[3]]
    assert [job.id for job in taken if job] == ids(expected)


def test_workers_that_just_started_go_on_with_the_next_owner(record: JobRecord, database_url: str) -> None:
    jobs = {owner: [posted(record, owner) for _ in range(9)] for owner in ("a", "b", "c")}
    workers = [JobRecord(database_url) for _ in range(6)]
    taken = [worker.leases.claim_next("worker", LEASE_S) for worker in workers]
    for worker in workers:
        worker.close()
    assert sorted(job.id for job in taken if job) == sorted(id_ for owned in jobs.values() for id_ in ids(owned[:2]))


def test_a_worker_takes_another_job_while_that_of_the_owner_whose_turn_it_is_is_held(record: JobRecord) -> None:
    if record.database.is_sqlite:
        pytest.skip("on SQLite nobody holds a row without holding all")
    held, free = posted(record, "a"), posted(record, "b")
    with record.database.write() as connection:
        connection.execute(sa.select(jobs_table.c.id).where(jobs_table.c.id == held.id).with_for_update())
        taken = record.leases.claim_next("worker", LEASE_S)
    assert taken is not None
    assert taken.id == free.id


def test_workers_take_the_most_urgent_job_and_of_equal_ones_the_oldest(record: JobRecord) -> None:
    usual, low, urgent, later = (posted(record, priority=priority) for priority in (0, -5, 7, 0))
    taken = [record.leases.claim_next("worker", LEASE_S) for _ in range(5)]
    assert [job.id if job else None for job in taken] == [urgent.id, usual.id, later.id, low.id, None]
    assert {job.attempt for job in taken if job} == {1}
    # One that is handed back is as old as it was.
    record.leases.release(usual.id, 1)
    posted(record, priority=0)
    again = record.leases.claim_next("worker", LEASE_S)
    assert again is not None
    assert (again.id, again.attempt) == (usual.id, 2)


def test_many_that_take_the_next_job_at_once_take_each_job_once(record: JobRecord, database_url: str) -> None:
    jobs = {new_job(record).id for _ in range(24)}
    records = [JobRecord(database_url) for _ in range(6)]

    def take(each: JobRecord) -> list[str]:
        return [job.id for job in iter(lambda: each.leases.claim_next("worker", LEASE_S), None)]

    with ThreadPoolExecutor(len(records)) as pool:
        taken = [job_id for found in pool.map(take, records) for job_id in found]
    for each in records:
        each.close()
    assert sorted(taken) == sorted(jobs)
    assert {record.get(job_id).attempt for job_id in jobs} == {1}


def test_a_failure_that_may_pass_is_tried_again_later_each_time(record: JobRecord) -> None:
    error = JobError.of(StoredFileError("Damaged."))
    job = new_job(record)
    for attempt, wait_s in ((1, 10), (2, 40), (3, 160)):
        claimed(record, job)
        assert record.get(job.id).error is None
        assert record.leases.postpone(job.id, attempt, error, 4, 10.0) is JobState.QUEUED
        waiting = record.get(job.id)
        assert (waiting.error, waiting.attempt) == (error, attempt)
        event = record.events.after(job.id)[-1]
        assert (event.type, event.data["reason"], event.data["error"]) == (
            EventType.QUEUED,
            "failure",
            error.model_dump(),
        )
        assert waiting.retry_at is not None
        assert event.data["retry_at"] == waiting.retry_at.isoformat()
        assert (waiting.retry_at - event.at).total_seconds() == pytest.approx(wait_s, abs=2)
        assert record.leases.claim_next("worker", LEASE_S) is None
        with record.database.write() as connection:
            connection.execute(sa.update(jobs_table).values(retry_at=record.database.now(-1.0)))
        assert record.upkeep.queued_ids(9) == [job.id]
    claimed(record, job)
    assert record.leases.postpone(job.id, 4, error, 4, 10.0) is JobState.FAILED
    failed = record.get(job.id)
    assert (failed.error, failed.finished_at is not None) == (error, True)
    with pytest.raises(StaleAttemptError):
        record.leases.postpone(job.id, 4, error, 4, 10.0)
    asked = claimed(record, new_job(record))
    record.request_cancel(asked.id)
    assert record.leases.postpone(asked.id, 1, error, 1, 10.0) is JobState.CANCELED
    assert record.get(asked.id).error is None
    waits = claimed(record, new_job(record))
    record.leases.postpone(waits.id, 1, error, 4, 10.0)
    assert record.request_cancel(waits.id).state is JobState.CANCELED
    assert record.get(waits.id).error is None


def test_new_progress_makes_earlier_failures_forgotten(record: JobRecord) -> None:
    error = JobError.of(StoredFileError("Damaged."))
    job = new_job(record)
    for attempt in range(1, 4):
        claimed(record, job)
        record.leases.set_checkpoint(job.id, attempt, f"key-{attempt}", attempt, "0" * 64)
        assert record.leases.postpone(job.id, attempt, error, 2, 0.0) is JobState.QUEUED


def test_the_fraction_never_goes_back_across_a_recovery(record: JobRecord) -> None:
    job = claimed(record, new_job(record), OVER)
    record.leases.save_progress(job.id, 1, at(6))
    record.upkeep.reclaim_expired(3)
    assert record.get(job.id).progress.fraction == 0.6
    claimed(record, job)
    for step in (2, 5, 7):
        record.leases.save_progress(job.id, 2, at(step))
    told = [event.data for event in record.events.after(job.id) if event.type == "progress"]
    assert told[-1] == record.get(job.id).progress.model_dump(mode="json")
    assert [(data["step"], data["fraction"], data["attempt"]) for data in told] == [
        (6, 0.6, 1), (2, 0.6, 2), (5, 0.6, 2), (7, 0.7, 2),
    ]  # fmt: skip


# Which workers are alive


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


@pytest.mark.both_databases
def test_a_job_that_the_device_has_no_memory_for_fails_in_the_end(record: JobRecord) -> None:
    job = new_job(record)
    for attempt in (1, 2):
        claimed(record, job)
        assert record.leases.out_of_memory(job.id, attempt, 3) is JobState.QUEUED
        assert record.get(job.id).oom_attempts == attempt
    claimed(record, job)
    assert record.leases.out_of_memory(job.id, 3, 3) is JobState.FAILED
    failed = record.get(job.id)
    assert failed.error is not None
    assert (failed.error.code, failed.oom_attempts) == ("gpu_oom", 3)
    assert failed.finished_at is not None
    asked = claimed(record, new_job(record))
    record.request_cancel(asked.id)
    assert record.leases.out_of_memory(asked.id, 1, 1) is JobState.CANCELED
    assert record.get(asked.id).error is None
