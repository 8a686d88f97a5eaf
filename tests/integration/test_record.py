"""The record, on a real SQLite file and a real PostgreSQL: what holds when several want the same job."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
import sqlalchemy as sa

from meshdeform.config import JobRequest
from meshdeform.errors import (
    ConflictError,
    DependencyError,
    NotFoundError,
    ParameterError,
    StaleAttemptError,
    UnavailableError,
)
from meshdeform.jobs.database import Database
from meshdeform.jobs.models import Artifact, Job, JobError, JobState, Progress
from meshdeform.jobs.record import JobRecord
from meshdeform.jobs.tables import HEAD, metadata
from tests.integration.conftest import DEADLINE_S, new_job, stored_file

LEASE_S = 60.0
OVER = -1.0  # a lease that was over when it was given: nobody has to wait for it


def claimed(record: JobRecord, job: Job, lease_s: float = LEASE_S) -> Job:
    taken = record.claim(job.id, "worker", lease_s)
    assert taken is not None
    return taken


def artifact(name: str = "result.glb", sha256: str = "c" * 64) -> Artifact:
    return Artifact(
        name=name, content_type="model/gltf-binary", size=7, sha256=sha256, key=f"jobs/x/{name}",
        created_at=datetime.now(UTC),
    )  # fmt: skip


def test_a_new_job_comes_back_as_it_was_written(record: JobRecord) -> None:
    request = JobRequest.model_validate({"prompt": " a Müller vase ", "params": {"steps": 3}, "metadata": {"a": "1"}})
    made = record.create(request, stored_file("a"), stored_file("b", "target.obj"))
    found = record.get(made.id)
    assert found == made
    assert (found.state, found.attempt, found.version) == (JobState.QUEUED, 0, 1)
    assert found.request == request
    assert found.params.model_fields_set == {"steps"}
    assert found.target == stored_file("b", "target.obj")
    assert found.created_at.tzinfo is not None
    assert abs(found.created_at - datetime.now(UTC)) < timedelta(minutes=5)
    assert found.error is None
    assert found.finished_at is None


def test_there_is_no_job_of_an_unknown_id(record: JobRecord) -> None:
    for look in (record.get, record.artifacts, record.delete, record.request_cancel):
        with pytest.raises(NotFoundError):
            look("job_nothing")
    assert record.claim("job_nothing", "worker", LEASE_S) is None
    with pytest.raises(NotFoundError):
        record.heartbeat("job_nothing", 1, LEASE_S)


def test_pages_hold_every_job_once_newest_first_also_when_jobs_come_in_between(record: JobRecord) -> None:
    ids = [new_job(record).id for _ in range(5)]
    first = record.list_jobs(limit=2)
    new_job(record)
    second = record.list_jobs(limit=2, cursor=first.next_cursor)
    third = record.list_jobs(limit=2, cursor=second.next_cursor)
    assert [job.id for page in (first, second, third) for job in page.jobs] == ids[::-1]
    assert third.next_cursor is None


def test_a_page_of_one_state(record: JobRecord) -> None:
    jobs = [new_job(record) for _ in range(3)]
    claimed(record, jobs[1])
    assert [job.id for job in record.list_jobs(JobState.RUNNING).jobs] == [jobs[1].id]
    assert [job.id for job in record.list_jobs(JobState.QUEUED).jobs] == [jobs[2].id, jobs[0].id]
    assert record.list_jobs(JobState.FAILED).jobs == []


@pytest.mark.parametrize("cursor", ["", "x", "!!", "am9", "bm9fam9i", "é"])
def test_a_cursor_that_is_not_ours_is_refused(record: JobRecord, cursor: str) -> None:
    with pytest.raises(ParameterError, match="cursor"):
        record.list_jobs(cursor=cursor)


def test_of_many_that_claim_one_job_at_once_one_gets_it(record: JobRecord, database_url: str) -> None:
    records = [JobRecord(database_url) for _ in range(4)]
    try:
        with ThreadPoolExecutor(len(records)) as pool:
            for _ in range(10):
                job = new_job(record)
                claims = [pool.submit(each.claim, job.id, f"worker {i}", LEASE_S) for i, each in enumerate(records)]
                won = [claim.result() for claim in claims if claim.result() is not None]
                assert len(won) == 1
                assert record.get(job.id).attempt == 1
    finally:
        for each in records:
            each.close()


def test_a_claim_is_a_new_attempt(record: JobRecord) -> None:
    job = claimed(record, new_job(record))
    assert (job.state, job.attempt, job.progress.attempt) == (JobState.RUNNING, 1, 1)
    assert job.started_at is not None
    assert job.version > 1
    assert record.claim(job.id, "another", LEASE_S) is None


def test_a_lease_that_is_over_can_be_claimed_and_then_the_old_attempt_writes_nothing(record: JobRecord) -> None:
    old = claimed(record, new_job(record), OVER)
    new = claimed(record, old)
    assert (new.attempt, new.started_at) == (2, old.started_at)
    writes: list[Any] = [
        lambda: record.heartbeat(old.id, 1, LEASE_S),
        lambda: record.save_progress(old.id, 1, Progress(step=9, total_steps=10, fraction=0.9, phase="optimizing")),
        lambda: record.set_checkpoint(old.id, 1, key="k", step=1, sha256="s"),
        lambda: record.forget_checkpoint(old.id, 1, key="k"),
        lambda: record.add_artifact(old.id, 1, artifact()),
        lambda: record.finish(old.id, 1, JobState.SUCCEEDED),
        lambda: record.release(old.id, 1),
    ]
    for write in writes:
        with pytest.raises(StaleAttemptError):
            write()
    assert record.get(old.id) == new
    assert record.checkpoints(old.id) == []


def test_a_heartbeat_keeps_the_lease(record: JobRecord) -> None:
    job = claimed(record, new_job(record), OVER)
    assert record.heartbeat(job.id, 1, LEASE_S) is JobState.RUNNING
    assert record.reclaim_expired(3) == []
    assert record.claim(job.id, "another", LEASE_S) is None


def test_progress_is_published_and_its_fraction_never_goes_back(record: JobRecord) -> None:
    job = claimed(record, new_job(record))
    far = Progress(
        step=6, total_steps=10, fraction=0.6, phase="optimizing", losses={"guidance": 0.25}, eta_s=1.5, attempt=1
    )
    record.save_progress(job.id, 1, far)
    assert record.get(job.id).progress == far
    record.save_progress(job.id, 1, far.model_copy(update={"step": 2, "fraction": 0.2}))
    progress = record.get(job.id).progress
    assert (progress.step, progress.fraction) == (2, 0.6)


def test_the_version_changes_with_everything_that_a_user_sees(record: JobRecord) -> None:
    job = new_job(record)
    seen = [job.version]

    def changed() -> bool:
        seen.append(record.get(job.id).version)
        return seen[-1] > seen[-2]

    record.claim(job.id, "worker", LEASE_S)
    assert changed()
    record.save_progress(job.id, 1, Progress(step=1, total_steps=2, fraction=0.5, phase="optimizing"))
    assert changed()
    record.heartbeat(job.id, 1, LEASE_S)
    assert not changed()
    record.request_cancel(job.id)
    assert changed()
    record.finish(job.id, 1, JobState.CANCELED)
    assert changed()


def test_success_is_for_good(record: JobRecord) -> None:
    job = claimed(record, new_job(record))
    record.finish(job.id, 1, JobState.SUCCEEDED)
    done = record.get(job.id)
    assert (done.state, done.progress.fraction) == (JobState.SUCCEEDED, 1.0)
    assert done.finished_at is not None
    with pytest.raises(StaleAttemptError):
        record.finish(job.id, 1, JobState.FAILED)
    with pytest.raises(ConflictError):
        record.request_cancel(job.id)
    assert record.claim(job.id, "worker", LEASE_S) is None
    assert record.reclaim_expired(1) == []
    assert record.get(job.id) == done


def test_failure_keeps_its_error(record: JobRecord) -> None:
    job = claimed(record, new_job(record))
    error = JobError(code="numerical_failure", title="t", detail="d", advice="a", status=500)
    record.finish(job.id, 1, JobState.FAILED, error)
    assert record.get(job.id).error == error
    assert record.get(job.id).state is JobState.FAILED


def test_only_a_terminal_state_ends_a_job(record: JobRecord) -> None:
    job = claimed(record, new_job(record))
    with pytest.raises(ValueError, match="not terminal"):
        record.finish(job.id, 1, JobState.QUEUED)


def test_a_queued_job_is_canceled_at_once(record: JobRecord) -> None:
    job = record.request_cancel(new_job(record).id)
    assert job.state is JobState.CANCELED
    assert job.finished_at is not None
    assert record.claim(job.id, "worker", LEASE_S) is None


def test_a_running_job_is_asked_to_stop_and_asking_twice_is_no_error(record: JobRecord) -> None:
    job = claimed(record, new_job(record))
    assert record.request_cancel(job.id).state is JobState.CANCELING
    assert record.request_cancel(job.id).state is JobState.CANCELING
    assert record.heartbeat(job.id, 1, LEASE_S) is JobState.CANCELING


@pytest.mark.parametrize("end", ["finish", "release", "reclaim"])
def test_a_cancel_that_was_promised_is_kept(record: JobRecord, end: str) -> None:
    job = claimed(record, new_job(record), OVER if end == "reclaim" else LEASE_S)
    record.request_cancel(job.id)
    if end == "finish":
        record.finish(job.id, 1, JobState.SUCCEEDED)
    elif end == "release":
        record.release(job.id, 1)
    else:
        assert record.reclaim_expired(3) == []
    canceled = record.get(job.id)
    assert canceled.state is JobState.CANCELED
    assert canceled.finished_at is not None


def test_a_released_job_waits_with_its_checkpoint_and_does_not_count_as_lost(record: JobRecord) -> None:
    job = new_job(record)
    for attempt in range(1, 6):
        claimed(record, job)
        record.set_checkpoint(job.id, attempt, key=f"k{attempt}", step=10 * attempt, sha256="s")
        record.release(job.id, attempt)
        assert record.get(job.id).state is JobState.QUEUED
    checkpoint = record.checkpoints(job.id)[0]
    assert (checkpoint.key, checkpoint.step, checkpoint.attempt) == ("k5", 50, 5)
    claimed(record, job, OVER)
    assert record.reclaim_expired(2) == [job.id]


def test_a_lost_job_is_queued_again_until_its_attempts_are_used_up(record: JobRecord) -> None:
    job = new_job(record)
    for attempt in (1, 2):
        assert claimed(record, job, OVER).attempt == attempt
        assert record.reclaim_expired(3) == [job.id]
    claimed(record, job, OVER)
    assert record.reclaim_expired(3) == []
    failed = record.get(job.id)
    assert failed.state is JobState.FAILED
    assert failed.error is not None
    assert failed.error.code == "worker_lost"
    assert failed.finished_at is not None


def test_a_worker_that_is_known_to_be_gone_loses_its_job_at_once_and_no_other_does(record: JobRecord) -> None:
    lost, kept = new_job(record), new_job(record)
    held = record.claim(lost.id, "gone", LEASE_S)
    assert held is not None
    record.claim(kept.id, "alive", LEASE_S)
    assert record.worker_ended("gone")
    assert record.reclaim_expired(2) == [lost.id]
    assert (record.get(lost.id).state, record.get(kept.id).state) == (JobState.QUEUED, JobState.RUNNING)
    with pytest.raises(StaleAttemptError):
        record.heartbeat(lost.id, held.attempt, LEASE_S)
    assert not record.worker_ended("gone")
    # It counts as a lost attempt.
    record.claim(lost.id, "gone too", LEASE_S)
    assert record.worker_ended("gone too")
    assert record.reclaim_expired(2) == []
    assert record.get(lost.id).state is JobState.FAILED


def test_the_newest_checkpoint_comes_first(record: JobRecord) -> None:
    job = claimed(record, new_job(record))
    assert record.checkpoints(job.id) == []
    for step in (100, 200, 300):
        record.set_checkpoint(job.id, 1, key=f"k{step}", step=step, sha256="s")
    record.set_checkpoint(job.id, 1, key="k300", step=300, sha256="again")
    assert [(found.step, found.sha256) for found in record.checkpoints(job.id)] == [
        (300, "again"), (200, "s"), (100, "s"),
    ]  # fmt: skip
    record.forget_checkpoint(job.id, 1, "k100")
    record.release(job.id, 1)
    claimed(record, job)
    record.set_checkpoint(job.id, 2, key="later", step=250, sha256="s")
    assert [found.step for found in record.checkpoints(job.id)] == [250, 300, 200]


def test_artifacts_are_those_of_the_present_attempt(record: JobRecord) -> None:
    job = claimed(record, new_job(record), OVER)
    record.add_artifact(job.id, 1, artifact("result.glb", "1" * 64))
    record.add_artifact(job.id, 1, artifact("report.json", "1" * 64))
    claimed(record, job)
    assert record.artifacts(job.id) == []
    mine = artifact("result.glb", "2" * 64)
    record.add_artifact(job.id, 2, mine)
    record.add_artifact(job.id, 2, mine)
    assert record.artifacts(job.id) == [mine]


def test_only_a_job_that_is_over_is_deleted(record: JobRecord) -> None:
    job = new_job(record)
    with pytest.raises(ConflictError, match="queued"):
        record.delete(job.id)
    claimed(record, job)
    record.add_artifact(job.id, 1, artifact())
    record.set_checkpoint(job.id, 1, key="k", step=1, sha256="s")
    with pytest.raises(ConflictError, match="running"):
        record.delete(job.id)
    record.finish(job.id, 1, JobState.SUCCEEDED)
    record.delete(job.id)
    with pytest.raises(NotFoundError):
        record.get(job.id)
    assert record.discarded_prefixes() == [f"jobs/{job.id}/"]
    record.forget_discarded(f"jobs/{job.id}/")
    assert record.discarded_prefixes() == []


def test_queued_jobs_are_told_oldest_first(record: JobRecord) -> None:
    jobs = [new_job(record) for _ in range(3)]
    claimed(record, jobs[0])
    assert record.queued_ids() == [jobs[1].id, jobs[2].id]


def test_a_file_is_unused_when_neither_a_job_nor_a_request_needs_it(record: JobRecord) -> None:
    key = stored_file("d").key
    record.files.pin(key)
    assert record.files.unused() == []
    job = new_job(record, letter="d")
    assert record.files.unused() == []
    record.request_cancel(job.id)
    record.delete(job.id)
    assert record.files.unused() == [key]
    record.files.pin(key)
    assert record.files.unused() == []
    removed: list[str] = []
    assert not record.files.remove_unused(key, removed.append)
    record.files.unpin([key])
    assert record.files.remove_unused(key, removed.append)
    assert not record.files.remove_unused(key, removed.append)
    assert removed == [key]


def test_two_requests_of_the_same_file_pin_it_twice(record: JobRecord) -> None:
    key = stored_file("e").key
    record.files.pin(key)
    record.files.pin(key)
    record.files.unpin([key])
    assert record.files.unused() == []
    record.files.unpin([key])
    assert record.files.unused() == [key]


def test_a_pin_waits_until_the_file_that_is_being_removed_is_gone(record: JobRecord) -> None:
    key = stored_file("f").key
    record.files.unpin([key])
    order: list[str] = []
    with ThreadPoolExecutor(1) as pool:

        def remove(_: str) -> None:
            pin = pool.submit(lambda: (record.files.pin(key), order.append("pinned")))
            # It cannot get through while the removal holds the row; a moment in which it could is enough to show it.
            with pytest.raises(TimeoutError):
                pin.result(timeout=0.3)
            order.append("removed")

        assert record.files.remove_unused(key, remove)
    assert order == ["removed", "pinned"]
    assert record.files.unused() == []


def test_many_threads_write_without_an_error(record: JobRecord) -> None:
    jobs = [claimed(record, new_job(record)) for _ in range(4)]

    def publish(job: Job) -> None:
        for step in range(1, 26):
            record.save_progress(job.id, 1, Progress(step=step, total_steps=25, fraction=step / 25, phase="optimizing"))
            record.heartbeat(job.id, 1, LEASE_S)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(publish, jobs))
    assert {record.get(job.id).progress.fraction for job in jobs} == {1.0}


def test_the_migrations_make_what_the_tables_say(record: JobRecord) -> None:
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext

    with record._database.read() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, metadata) == []
        assert context.get_current_revision() == HEAD


def test_many_may_start_on_an_empty_database_at_once(database_url: str, record: JobRecord) -> None:
    with record._database.write() as connection:
        metadata.drop_all(connection)
        connection.execute(sa.text("DROP TABLE alembic_version"))
    with ThreadPoolExecutor(4) as pool:
        opened = list(pool.map(JobRecord, [database_url] * 4))
    assert opened[0].queued_ids() == []
    for each in opened:
        each.close()


def test_a_record_of_a_newer_version_is_refused(database_url: str, record: JobRecord) -> None:
    def say(version: str) -> None:
        with record._database.write() as connection:
            connection.execute(sa.text("UPDATE alembic_version SET version_num = :version"), {"version": version})

    say("9999")
    try:
        with pytest.raises(UnavailableError, match="newer"):
            JobRecord(database_url)
    finally:
        say(HEAD)


@pytest.mark.parametrize(
    "url", ["nonsense", "sqlite://", "sqlite:///:memory:", "postgresql+nodriver://host/x", "oracle9://x"]
)
def test_a_url_that_means_nothing_is_refused_with_advice(url: str) -> None:
    with pytest.raises(DependencyError) as caught:
        Database(url)
    assert "sqlite" in caught.value.advice_text


def test_a_database_that_does_not_answer_is_unavailable() -> None:
    started = time.monotonic()
    with pytest.raises(UnavailableError):
        Database("postgresql://nobody@127.0.0.1:1/nothing")
    assert time.monotonic() - started < DEADLINE_S


def test_sqlite_is_durable(tmp_path) -> None:
    database = Database(f"sqlite:///{tmp_path}/deep/er/record.sqlite")
    with database.read() as connection:
        pragma = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar_one()
            for name in ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
        }
    assert pragma == {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1, "busy_timeout": 30_000}
    database.close()
