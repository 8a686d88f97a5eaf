"""The record, on a real SQLite file and a real PostgreSQL: what users do with their jobs."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta

import pytest

from meshdeform.errors import ConflictError, NotFoundError, ParameterError, TooManyJobsError
from meshdeform.record.models import EventType, Job, JobState, NewJob, Origin, OriginMode, Progress
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from tests.cases import each_case
from tests.claims import claim_job
from tests.integration.conftest import new_job, stored_file
from tests.integration.record_calls import LEASE_S, artifact, claimed, history, ids, posted

pytestmark = pytest.mark.both_databases


def test_a_new_job_comes_back_as_it_was_written(record: JobRecord) -> None:
    params = {"steps": 3, "guidance": {"kind": "sds"}}
    request = JobRequest.model_validate({"prompt": " a Müller vase ", "params": params, "metadata": {"a": "1"}})
    made = record.create(NewJob(request, {"asset": stored_file("a"), "target": stored_file("b", "target.obj")}))
    found = record.get(made.id)
    assert found == made
    assert (found.state, found.attempt, found.version) == (JobState.QUEUED, 0, 1)
    assert (found.oom_attempts, found.ran_s, found.event_seq, found.progress) == (0, 0.0, 1, Progress())
    assert found.request == request
    assert found.request.params.model_fields_set == {"steps", "guidance"}
    assert found.files["target"] == stored_file("b", "target.obj")
    assert found.created_at.tzinfo is not None
    assert abs(found.created_at - datetime.now(UTC)) < timedelta(minutes=5)
    assert found.error is None
    assert found.finished_at is None


def test_pages_hold_every_job_once_newest_first_also_when_jobs_come_in_between(record: JobRecord) -> None:
    ids = [new_job(record).id for _ in range(5)]
    first = record.list_jobs(limit=2)
    new_job(record)
    second = record.list_jobs(limit=2, cursor=first.next_cursor)
    third = record.list_jobs(limit=2, cursor=second.next_cursor)
    assert [job.id for page in (first, second, third) for job in page.jobs] == ids[::-1]
    assert third.next_cursor is None
    assert record.list_jobs(limit=6).next_cursor is None, "a full page may be the last one"


@each_case("cursor", ["", "x", "!!", "am9", "bm9fam9i", "é"])
def test_a_cursor_that_is_not_ours_is_refused(record: JobRecord, cursor: str) -> None:
    with pytest.raises(ParameterError, match="cursor"):
        record.list_jobs(cursor=cursor)


def test_the_version_changes_with_everything_that_a_user_sees(record: JobRecord) -> None:
    job = new_job(record)
    seen = [job.version]

    def changed() -> bool:
        seen.append(record.get(job.id).version)
        return seen[-1] > seen[-2]

    claim_job(record.leases, job.id, "worker", LEASE_S)
    assert changed()
    record.leases.save_progress(job.id, 1, Progress(step=1, total_steps=2, fraction=0.5, phase="optimizing"))
    assert changed()
    record.leases.heartbeat(job.id, 1, LEASE_S)
    assert not changed()
    record.request_cancel(job.id)
    assert changed()
    record.leases.finish(job.id, 1, JobState.CANCELED)
    assert changed()


def test_owners_see_their_own_jobs_and_no_others(record: JobRecord) -> None:
    mine, theirs = posted(record, "me", metadata={"a": "1"}), posted(record, "them", metadata={"a": "1"})
    for look in (record.get, record.artifacts, record.request_cancel, record.delete):
        with pytest.raises(NotFoundError):
            look(theirs.id, "me")
    with pytest.raises(NotFoundError):
        record.events.after(theirs.id, owner="me")
    assert history(record, theirs.id) == [EventType.QUEUED]
    assert ids(record.list_jobs(owner="me").jobs) == [mine.id]
    assert ids(record.list_jobs(owner="me", metadata={"a": "1"}).jobs) == [mine.id]
    assert ids(record.list_jobs(JobState.QUEUED, owner="them").jobs) == [theirs.id]
    assert record.list_jobs(JobState.RUNNING, owner="them").jobs == []
    # All labels must be there.
    both = posted(record, "you", metadata={"a": "1", "b": "2"})
    assert ids(record.list_jobs(metadata={"a": "1", "b": "2"}).jobs) == [both.id]
    assert record.list_jobs(metadata={"1": "a"}).jobs == []
    record.request_cancel(both.id)
    record.delete(both.id)
    assert ids(record.list_jobs().jobs) == [theirs.id, mine.id]
    # Where keys are off everybody's jobs are nobody's; whoever has a key sees none of them.
    nobodys = posted(record, "")
    assert ids(record.list_jobs(owner="").jobs) == [nobodys.id]
    assert record.get(mine.id, "me") == mine


def test_a_job_that_continues_another_says_so_and_holds_the_copy_of_its_checkpoint(record: JobRecord) -> None:
    origin = Origin(job_id="job_gone", step=70, mode=OriginMode.BRANCH, key="assets/copy", sha256="d" * 64)
    record.files.pin(origin.key)
    job = record.create(NewJob(JobRequest(prompt="a mushroom"), {"asset": stored_file()}, origin=origin))
    assert record.get(job.id).origin == origin
    data = record.events.after(job.id)[0].data
    assert data == {"reason": "branch", "origin": {"job_id": "job_gone", "step": 70}}
    assert record.files.unused() == []
    record.request_cancel(job.id)
    record.delete(job.id)
    assert "assets/copy" in record.files.unused()


def test_an_owner_has_only_so_many_unfinished_jobs_also_when_they_come_at_once(record: JobRecord) -> None:
    def post(_: int) -> Job | None:
        try:
            return posted(record, "me", 3)
        except TooManyJobsError:
            return None

    with ThreadPoolExecutor(8) as pool:
        made = [job for job in pool.map(post, range(16)) if job is not None]
    assert len(made) == 3
    posted(record, "another", 3)
    claimed(record, made[0])
    with pytest.raises(TooManyJobsError) as refused:
        posted(record, "me", 3)
    assert refused.value.status == 429
    record.leases.finish(made[0].id, 1, JobState.SUCCEEDED)
    assert posted(record, "me", 3).state is JobState.QUEUED
    # Nothing of those that were refused is left.
    assert len(record.list_jobs(owner="me").jobs) == 4


def test_artifacts_are_published_with_success_and_only_then(record: JobRecord) -> None:
    made = [artifact("result.glb"), artifact("report.json")]
    success = claimed(record, new_job(record))
    assert record.artifacts(success.id) == []
    record.leases.finish(success.id, 1, JobState.SUCCEEDED, results=made)
    assert record.artifacts(success.id) == sorted(made, key=lambda result: result.name)
    assert record.events.after(success.id)[-1].data == {"artifacts": ["report.json", "result.glb"]}
    for end in (JobState.FAILED, JobState.CANCELED, JobState.EXPIRED):
        other = claimed(record, new_job(record))
        record.leases.finish(other.id, 1, end, results=made)
        assert record.artifacts(other.id) == []
    asked = claimed(record, new_job(record))
    record.request_cancel(asked.id)
    assert record.leases.finish(asked.id, 1, JobState.SUCCEEDED, results=made) is JobState.CANCELED
    assert record.artifacts(asked.id) == []
    assert record.get(asked.id).progress.fraction == 0.0


def test_only_a_job_that_is_over_is_deleted_with_all_that_belongs_to_it(record: JobRecord) -> None:
    job = posted(record, metadata={"a": "1"})
    with pytest.raises(ConflictError, match="queued"):
        record.delete(job.id)
    claimed(record, job)
    record.leases.set_checkpoint(job.id, 1, key="k", step=1, sha256="s")
    with pytest.raises(ConflictError, match="running"):
        record.delete(job.id)
    record.leases.finish(job.id, 1, JobState.SUCCEEDED, results=[artifact()])
    record.delete(job.id)
    with pytest.raises(NotFoundError):
        record.get(job.id)
    with pytest.raises(NotFoundError):
        record.events.after(job.id)
    assert record.leases.checkpoints(job.id) == []
    assert record.events.heads([job.id]) == {}
    assert record.list_jobs(metadata={"a": "1"}).jobs == []
    assert record.upkeep.discarded_prefixes() == [f"jobs/{job.id}/"]
    record.upkeep.forget_discarded(f"jobs/{job.id}/")
    assert record.upkeep.discarded_prefixes() == []


def test_a_secret_is_made_once_also_by_many_at_once(record: JobRecord) -> None:
    with ThreadPoolExecutor(6) as pool:
        found = set(pool.map(record.secret, ["signing"] * 12))
    assert len(found) == 1
    assert len(found.pop()) == 32
    assert record.secret("another") != record.secret("signing")
