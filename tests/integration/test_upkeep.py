"""What the reconciler does with the record, on SQLite and PostgreSQL: leases, deadlines, retention, tallies."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest

from meshdeform.errors import NotFoundError, StaleAttemptError
from meshdeform.record.counters import Counters
from meshdeform.record.models import Job, JobState, NewJob
from meshdeform.record.repository import JobRecord
from tests.integration.conftest import new_job, stored_file
from tests.integration.record_calls import LEASE_S, OVER, claimed, history, ids, late, posted, set_to

pytestmark = pytest.mark.both_databases


def test_queued_jobs_are_told_the_most_urgent_first(record: JobRecord) -> None:
    usual, urgent, other = posted(record), posted(record, priority=3), posted(record)
    taken = claimed(record, posted(record))
    assert record.upkeep.queued_ids(9) == [urgent.id, usual.id, other.id]
    assert record.upkeep.queued_ids(2) == [urgent.id, usual.id]
    assert (record.upkeep.queued_count(9), record.upkeep.queued_count(2)) == (3, 2)
    assert taken.id not in record.upkeep.queued_ids(9)


def test_many_jobs_are_taken_back_in_one_look(record: JobRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("meshdeform.record.upkeep._BATCH", 10)
    jobs = [claimed(record, new_job(record), OVER) for _ in range(23)]
    asked = jobs[7]
    record.request_cancel(asked.id)
    assert record.upkeep.reclaim_expired(3) == [job.id for job in jobs if job.id != asked.id]
    assert record.get(asked.id).state is JobState.CANCELED
    assert record.upkeep.reclaim_expired(3) == []
    assert record.counters()["lease_expirations", ""] == 23
    assert record.counters()["recoveries", ""] == 22


def test_reconcilers_that_look_at_once_take_each_job_back_once(record: JobRecord, database_url: str) -> None:
    jobs = [claimed(record, new_job(record), OVER) for _ in range(40)]
    records = [JobRecord(database_url) for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        taken = [job_id for found in pool.map(lambda each: each.upkeep.reclaim_expired(3), records) for job_id in found]
    for each in records:
        each.close()
    taken += record.upkeep.reclaim_expired(3)
    assert sorted(taken) == sorted(ids(jobs))
    for job in jobs:
        assert history(record, job.id) == ["queued", "started", "recovered"]


def test_a_job_ends_at_its_deadline_wherever_it_is(record: JobRecord) -> None:
    queued, running, asked = late(record), claimed(record, late(record)), claimed(record, late(record))
    in_time = posted(record, deadline_s=3600.0)
    record.request_cancel(asked.id)
    assert in_time.deadline_at is not None
    assert (in_time.deadline_at - in_time.created_at).total_seconds() == pytest.approx(3600.0, abs=60.0)
    assert record.upkeep.expire_deadlines() == sorted(ids([running, asked]))
    assert record.upkeep.expire_deadlines() == []
    assert record.get(queued.id).state is JobState.EXPIRED
    assert record.get(running.id).finished_at is not None
    # Its user was told that it would be canceled.
    assert record.get(asked.id).state is JobState.CANCELED
    assert record.get(in_time.id).state is JobState.QUEUED
    with pytest.raises(StaleAttemptError):
        record.leases.heartbeat(running.id, 1, LEASE_S)


def test_jobs_are_deleted_when_their_time_is_over(record: JobRecord) -> None:
    forever, by_default, by_request = (
        record.create(NewJob(posted(record).request, {"asset": stored_file()})),
        record.create(NewJob(posted(record).request, {"asset": stored_file()}, retention_s=3600.0)),
        record.create(NewJob(posted(record, retention_s=7200.0).request, {"asset": stored_file()}, retention_s=3600.0)),
    )
    kept = {}
    for job in (forever, by_default, by_request):
        assert job.retain_until is None
        ended = record.request_cancel(job.id)
        assert ended == record.get(job.id)
        kept[job.id] = ended.retain_until and (ended.retain_until - job.created_at).total_seconds()
    assert kept[forever.id] is None
    assert kept[by_default.id] == pytest.approx(3600.0, abs=60.0)
    assert kept[by_request.id] == pytest.approx(7200.0, abs=60.0)
    assert record.upkeep.delete_retained() == []
    set_to(record, by_default, retain_until=record.database.now(-1.0))
    assert record.upkeep.delete_retained() == [by_default.id]
    with pytest.raises(NotFoundError):
        record.get(by_default.id)
    assert record.upkeep.discarded_prefixes() == [f"jobs/{by_default.id}/"]
    assert record.upkeep.delete_retained() == []
    assert record.get(by_request.id).state is JobState.CANCELED


def test_a_lease_of_a_clock_that_was_set_back_is_cut(record: JobRecord) -> None:
    ahead, usual = claimed(record, new_job(record), 86_400.0), claimed(record, new_job(record), LEASE_S)
    assert record.upkeep.shorten_leases(LEASE_S) == 1
    assert record.upkeep.shorten_leases(LEASE_S) == 0
    assert record.upkeep.reclaim_expired(3) == []
    # Whoever lives keeps it, as ever.
    assert record.leases.heartbeat(ahead.id, 1, OVER) is JobState.RUNNING
    assert record.upkeep.reclaim_expired(3) == [ahead.id]
    assert record.get(usual.id).state is JobState.RUNNING


def test_results_of_lost_attempts_are_given_up_but_no_checkpoint_that_the_record_points_at(record: JobRecord) -> None:
    job = new_job(record)
    for attempt in (1, 2, 3):
        claimed(record, job, OVER)
        if attempt == 2:
            record.leases.set_checkpoint(job.id, attempt, key=f"jobs/{job.id}/2/checkpoint-000005", step=5, sha256="s")
        record.upkeep.reclaim_expired(9)
    claimed(record, job)
    assert record.upkeep.discarded_prefixes() == []
    record.leases.finish(job.id, 4, JobState.SUCCEEDED)
    assert sorted(record.upkeep.discarded_prefixes()) == [f"jobs/{job.id}/1/", f"jobs/{job.id}/3/"]
    record.delete(job.id)
    assert sorted(record.upkeep.discarded_prefixes()) == [f"jobs/{job.id}/", f"jobs/{job.id}/1/", f"jobs/{job.id}/3/"]


def test_a_duration_is_in_the_first_bucket_that_holds_it(record: JobRecord) -> None:
    with record.database.write() as connection:
        tallies = Counters(record.database, connection)
        for seconds in (-3.0, 0.005, 0.0051, 31.0):
            tallies.observe("step_seconds", seconds)
        tallies.write()
    sums = record.counters()
    assert [sums["step_seconds_bucket", label] for label in ("0.005", "0.01", "inf")] == [2, 1, 1]
    assert sums["step_seconds_sum", ""] == pytest.approx(31.0101)


def test_many_that_end_and_take_back_at_once_never_wait_in_a_circle(record: JobRecord, database_url: str) -> None:
    jobs = [claimed(record, late(record) if number % 3 == 0 else new_job(record), OVER) for number in range(60)]
    records = [JobRecord(database_url) for _ in range(6)]

    def look(each: JobRecord) -> None:
        for _ in range(4):
            each.upkeep.reclaim_expired(9)
            each.upkeep.expire_deadlines()
            each.upkeep.shorten_leases(LEASE_S)

    def work(each: JobRecord, mine: list[Job]) -> None:
        for job in mine:
            with suppress(StaleAttemptError):
                each.leases.finish(job.id, 1, JobState.SUCCEEDED, step_s=0.1)
            if (taken := each.leases.claim_next("worker", OVER)) is not None:
                with suppress(StaleAttemptError):
                    each.leases.release(taken.id, taken.attempt)

    with ThreadPoolExecutor(6) as pool:
        running = [pool.submit(look, each) for each in records[:3]]
        running += [pool.submit(work, each, jobs[start::3]) for start, each in enumerate(records[3:])]
        for each in running:
            each.result()  # a deadlock is an error that PostgreSQL gives to one of the two
    for each in records:
        each.close()
    ended = 0
    for job in jobs:
        ended += history(record, job.id)[-1].terminal
    assert ended == sum(value for (name, _), value in record.counters().items() if name == "jobs_ended")
