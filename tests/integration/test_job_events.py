"""Events of jobs, on SQLite and PostgreSQL: for whatever can happen to a job they are 1, 2, 3 ... with one end."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest
import sqlalchemy as sa

from meshdeform.errors import ConflictError, NotFoundError, StaleAttemptError
from meshdeform.record.models import EventType, Job, JobError, JobState
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import webhooks
from tests.cases import each_case
from tests.claims import claim_job
from tests.integration.conftest import DEADLINE_S, new_job
from tests.integration.record_calls import LEASE_S, OVER, artifact, at, claimed, history, late, posted

pytestmark = pytest.mark.both_databases

Path = Callable[[JobRecord], Job]


def _succeeds(record: JobRecord) -> Job:
    job = claimed(record, new_job(record))
    record.leases.save_progress(job.id, 1, at(2))
    record.leases.save_progress(job.id, 1, at(3), as_event=False)
    record.leases.set_checkpoint(job.id, 1, key="k", step=3, sha256="s")
    record.leases.finish(job.id, 1, JobState.SUCCEEDED, results=[artifact()])
    return job


def _fails(record: JobRecord) -> Job:
    job = claimed(record, new_job(record))
    record.leases.finish(job.id, 1, JobState.FAILED, JobError(code="c", title="t", detail="d", advice="a"))
    return job


def _is_canceled_in_the_queue(record: JobRecord) -> Job:
    return record.request_cancel(new_job(record).id)


def _is_canceled_while_it_runs(record: JobRecord) -> Job:
    job = claimed(record, new_job(record))
    record.request_cancel(job.id)
    record.request_cancel(job.id)
    record.leases.finish(job.id, 1, JobState.CANCELED)
    return job


def _is_canceled_before_its_success_is_written(record: JobRecord) -> Job:
    job = claimed(record, new_job(record))
    record.request_cancel(job.id)
    assert record.leases.finish(job.id, 1, JobState.SUCCEEDED, results=[artifact()]) is JobState.CANCELED
    return job


def _is_canceled_and_handed_back(record: JobRecord) -> Job:
    job = claimed(record, new_job(record))
    record.request_cancel(job.id)
    record.leases.release(job.id, 1)
    return job


def _is_canceled_and_loses_its_worker(record: JobRecord) -> Job:
    job = claimed(record, new_job(record), OVER)
    record.request_cancel(job.id)
    assert record.upkeep.reclaim_expired(3) == []
    return job


def _is_handed_back(record: JobRecord) -> Job:
    job = claimed(record, new_job(record))
    record.leases.release(job.id, 1)
    claimed(record, job)
    record.leases.finish(job.id, 2, JobState.SUCCEEDED)
    return job


def _is_recovered(record: JobRecord) -> Job:
    job = claimed(record, new_job(record), OVER)
    assert record.upkeep.reclaim_expired(3) == [job.id]
    claimed(record, job)
    record.leases.finish(job.id, 2, JobState.SUCCEEDED)
    return job


def _loses_every_worker(record: JobRecord) -> Job:
    job = new_job(record)
    for _ in range(2):
        claimed(record, job, OVER)
        record.upkeep.reclaim_expired(2)
    return job


def _finds_no_memory(record: JobRecord) -> Job:
    job = new_job(record)
    for attempt in (1, 2):
        claimed(record, job)
        record.leases.out_of_memory(job.id, attempt, 2)
    return job


def _is_canceled_and_finds_no_memory(record: JobRecord) -> Job:
    job = claimed(record, new_job(record))
    record.request_cancel(job.id)
    assert record.leases.out_of_memory(job.id, 1, 1) is JobState.CANCELED
    return job


def _is_late_in_the_queue(record: JobRecord) -> Job:
    job = late(record)
    record.upkeep.expire_deadlines()
    return job


def _is_late_while_it_runs(record: JobRecord) -> Job:
    job = claimed(record, late(record))
    assert record.upkeep.expire_deadlines() == [job.id]
    return job


def _is_late_and_canceled(record: JobRecord) -> Job:
    job = claimed(record, late(record))
    record.request_cancel(job.id)
    assert record.upkeep.expire_deadlines() == [job.id]
    return job


@each_case(
    ("path", "expected"),
    [
        (new_job, "queued"),
        (_succeeds, "queued started progress checkpoint succeeded"),
        (_fails, "queued started failed"),
        (_is_canceled_in_the_queue, "queued canceled"),
        (_is_canceled_while_it_runs, "queued started canceling canceled"),
        (_is_canceled_before_its_success_is_written, "queued started canceling canceled"),
        (_is_canceled_and_handed_back, "queued started canceling canceled"),
        (_is_canceled_and_loses_its_worker, "queued started canceling canceled"),
        (_is_handed_back, "queued started queued started succeeded"),
        (_is_recovered, "queued started recovered started succeeded"),
        (_loses_every_worker, "queued started recovered started failed"),
        (_finds_no_memory, "queued started queued started failed"),
        (_is_canceled_and_finds_no_memory, "queued started canceling canceled"),
        (_is_late_in_the_queue, "queued expired"),
        (_is_late_while_it_runs, "queued started expired"),
        (_is_late_and_canceled, "queued started canceling canceled"),
    ],
)
def test_events_tell_what_happened_without_a_gap_and_end_once(record: JobRecord, path: Path, expected: str) -> None:
    job = path(record)
    assert history(record, job.id) == expected.split()
    # A job that is over stays as it is, whoever tries what.
    done = record.get(job.id)
    if done.state.terminal:
        assert done.finished_at is not None
        assert (done.error is not None) == (done.state is JobState.FAILED)
        assert (done.progress.fraction == 1.0) == (done.state is JobState.SUCCEEDED)
        record.upkeep.reclaim_expired(1)
        record.upkeep.expire_deadlines()
        assert claim_job(record.leases, job.id, "another", LEASE_S) is None
        for again in (
            lambda: record.leases.finish(job.id, done.attempt, JobState.FAILED),
            lambda: record.leases.save_progress(job.id, done.attempt, at(9)),
            lambda: record.request_cancel(job.id),
        ):
            with pytest.raises((StaleAttemptError, ConflictError)):
                again()
        assert history(record, job.id) == expected.split()
        assert record.get(job.id) == done
    else:
        assert record.events.after(job.id)[0].data == {"reason": "created"}


def test_an_end_says_why(record: JobRecord) -> None:
    errors = {
        path: (record.events.after(path(record).id)[-1].data.get("error") or {}).get("code")
        for path in (_fails, _loses_every_worker, _finds_no_memory, _is_late_in_the_queue)
    }
    assert list(errors.values()) == ["c", "worker_lost", "gpu_oom", None]
    recovered = record.events.after(_is_recovered(record).id)
    assert [event.data for event in recovered if event.type is EventType.RECOVERED] == [{"lost_attempts": 1}]
    handed = record.events.after(_is_handed_back(record).id)
    assert [event.data for event in handed if event.type is EventType.QUEUED][1] == {"reason": "handed_back"}


def test_events_come_in_pages_that_begin_anywhere(record: JobRecord) -> None:
    job = _succeeds(record)
    every = record.events.after(job.id)
    assert record.events.after(job.id, 2) == every[2:]
    assert record.events.after(job.id, 1, limit=2) == every[1:3]
    assert record.events.after(job.id, 99) == []
    assert all(event.at.tzinfo is not None for event in every)
    assert [event.at for event in every] == sorted(event.at for event in every)
    assert [event.attempt for event in every] == [0, 1, 1, 1, 1]
    with pytest.raises(NotFoundError):
        record.events.after("job_nothing")


def test_many_that_write_to_one_job_at_once_leave_no_gap(record: JobRecord) -> None:
    job = claimed(record, new_job(record))

    def write(number: int) -> None:
        with suppress(StaleAttemptError, ConflictError):
            if number == 20:
                record.request_cancel(job.id)
            elif number == 30:
                record.leases.finish(job.id, 1, JobState.SUCCEEDED)
            elif number % 3:
                record.leases.save_progress(job.id, 1, at(number, 40))
            else:
                record.leases.set_checkpoint(job.id, 1, key=f"k{number}", step=number, sha256="s")

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(40)))
    told = history(record, job.id)
    assert told[:2] == [EventType.QUEUED, EventType.STARTED]
    assert told[-1].terminal
    fractions = [event.data["fraction"] for event in record.events.after(job.id) if event.type is EventType.PROGRESS]
    assert fractions == sorted(fractions)


def test_an_end_that_many_want_at_once_comes_once(record: JobRecord) -> None:
    for _ in range(5):
        job = claimed(record, late(record), OVER)
        ends: list[Callable[[], object]] = [
            lambda job=job: record.leases.finish(job.id, 1, JobState.SUCCEEDED),
            lambda job=job: record.request_cancel(job.id),
            lambda: record.upkeep.expire_deadlines(),
            lambda: record.upkeep.reclaim_expired(1),
            lambda job=job: record.leases.release(job.id, 1),
            lambda job=job: record.leases.out_of_memory(job.id, 1, 1),
        ]

        def attempt(end: Callable[[], object]) -> None:
            with suppress(StaleAttemptError, ConflictError):
                end()

        with ThreadPoolExecutor(len(ends)) as pool:
            list(pool.map(attempt, ends))
        record.upkeep.expire_deadlines()
        assert history(record, job.id)[-1].terminal


def test_a_webhook_that_is_deleted_at_the_same_time_is_no_obstacle(record: JobRecord) -> None:
    webhook, _ = record.webhooks.create("me", "https://example.org/hook")
    with ThreadPoolExecutor(1) as pool:
        with record.database.write() as connection:
            connection.execute(sa.delete(webhooks).where(webhooks.c.id == webhook.id))
            made = pool.submit(posted, record, "me")
            # It waits for the end of this transaction; a moment in which it could go on is enough to show it.
            with pytest.raises(TimeoutError):
                made.result(timeout=0.3)
        job = made.result(timeout=DEADLINE_S)
    assert history(record, job.id) == [EventType.QUEUED]
