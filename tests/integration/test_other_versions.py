"""One row may not stop a fleet: jobs that only another version can read, in every state, beside ordinary ones."""

from __future__ import annotations

import pytest

from meshdeform.errors import ConflictError, UnreadableJobError
from meshdeform.record.models import EventType, Job, JobState
from meshdeform.record.queue import JobQueue
from meshdeform.record.reconciler import Reconciler
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from service.jobs.estimates import estimate
from tests.claims import claim_job
from tests.integration.other_versions import LATER, accepted_elsewhere
from tests.integration.record_calls import LEASE_S, OVER, artifact, history, ids, posted, set_to
from tests.integration.test_reconciler import Paused


def left(job: Job, record: JobRecord, state: JobState) -> Job:
    """Bring a queued job to a state, as a worker that can read it does. Whoever has it is silent now."""
    if state is JobState.QUEUED:
        return job
    if state is JobState.EXPIRED:
        set_to(record, job, deadline_at=record.database.now(-1.0))
        record.upkeep.expire_deadlines()
        return record.get(job.id)
    if state is JobState.CANCELED:
        return record.request_cancel(job.id)
    set_to(
        record,
        job,
        state=JobState.RUNNING,
        attempt=1,
        worker_id="elsewhere",
        lease_expires_at=record.database.now(OVER),
    )
    if state is JobState.CANCELING:
        return record.request_cancel(job.id)
    if state.terminal:
        results = [artifact()] if state is JobState.SUCCEEDED else []
        record.leases.finish(job.id, 1, state, results=results)
    return record.get(job.id)


@pytest.mark.both_databases
def test_what_a_later_version_accepted_is_shown_as_it_is_in_every_state(record: JobRecord) -> None:
    record.webhooks.create("", "https://hooks.example/")
    jobs = {
        left(accepted_elsewhere(record, document), record, state).id: (document, state)
        for document in LATER.values()
        for state in JobState
    }
    for job_id, (document, state) in jobs.items():
        found = record.get(job_id)
        assert (found.state, found.document, found.kind) == (state, document, document.get("kind", "text_deform"))
        assert found.unreadable is not None
        with pytest.raises(UnreadableJobError):
            _ = found.request
        assert [event.seq for event in record.events.after(job_id)] == list(range(1, found.event_seq + 1))
    assert set(ids(record.list_jobs().jobs)) == set(jobs)
    # Creations were told while the jobs were ordinary ones.
    due = [each.payload for each in record.deliveries.due(1000, each=1000, each_owner=1000)]
    told = [payload["data"]["job"] for payload in due if payload["type"] != "job.queued"]
    assert all(shown["params"] in (jobs[shown["id"]][0]["params"], {}) for shown in told)
    # Those that run are asked to stop, and five states are the end of something.
    assert len(told) == 5 * len(LATER)
    estimate(record.database, record.leases, JobRequest(prompt="a vase"), default_model="builtin", queue="test")


@pytest.mark.both_databases
def test_it_is_recovered_canceled_expired_and_deleted_with_the_others(record: JobRecord) -> None:
    def both(state: JobState) -> list[Job]:
        each = [accepted_elsewhere(record, document) for document in LATER.values()]
        return [left(job, record, state) for job in [*each, posted(record)]]

    queued, running, canceling, over = map(
        both, (JobState.QUEUED, JobState.RUNNING, JobState.CANCELING, JobState.FAILED)
    )
    assert record.upkeep.reclaim_expired(3) == sorted(ids(running))
    assert {record.get(each.id).state for each in running} == {JobState.QUEUED}
    assert {record.get(each.id).state for each in canceling} == {JobState.CANCELED}
    for job in queued:
        assert record.request_cancel(job.id).state is JobState.CANCELED
        with pytest.raises(ConflictError):
            record.request_cancel(job.id)
    for job in running:
        set_to(record, job, deadline_at=record.database.now(-1.0))
    record.upkeep.expire_deadlines()
    for job in running:
        assert history(record, job.id)[-2:] == [EventType.RECOVERED, EventType.EXPIRED]
    for job in canceling:
        set_to(record, job, retain_until=record.database.now(-1.0))
    assert record.upkeep.delete_retained() == sorted(ids(canceling))
    for job in [*queued, *over, *running]:
        record.delete(job.id)
    assert record.list_jobs().jobs == []


@pytest.mark.both_databases
def test_workers_pass_over_it_and_take_the_others_in_their_order(record: JobRecord) -> None:
    later = [accepted_elsewhere(record, document, priority=5) for document in LATER.values()]
    later += [accepted_elsewhere(record, document, owner_id="b") for document in LATER.values()]
    ordinary = [posted(record, owner_id) for owner_id in ("a", "b", "a", "b")]
    later += [accepted_elsewhere(record, document) for document in LATER.values()]
    taken = [record.leases.claim_next(f"worker {number}", LEASE_S) for number in range(5)]
    # Owners take turns, as if the others were not there.
    assert [job.id if job else None for job in taken] == [*ids(ordinary), None]
    for job in later:
        assert claim_job(record.leases, job.id, "worker", LEASE_S) is None
        now = record.get(job.id)
        assert (now.state, now.attempt, now.version, now.event_seq) == (JobState.QUEUED, 0, 1, 1)


@pytest.mark.both_databases
def test_what_is_out_of_bounds_by_now_is_run_as_it_was_accepted(record: JobRecord) -> None:
    params = {"steps": 10**9, "seed": -3, "learning_rate": 30.0, "control": {"regions": [{"node": "n" * 5000}] * 100}}
    document = {"prompt": "a vase " * 1000, "params": params, "metadata": {"shot": "x" * 5000}}
    job = accepted_elsewhere(record, document, priority=10**6, fraction=1.5)
    for found in (record.get(job.id), *record.list_jobs().jobs, record.leases.claim_next("worker", LEASE_S)):
        assert found is not None
        assert found.unreadable is None
        assert (found.request.params.steps, found.request.params.seed) == (10**9, -3)
        assert len(found.request.params.control.regions) == 100
        assert (found.priority, found.progress.fraction) == (10**6, 1.5)
    assert record.request_cancel(job.id).state is JobState.CANCELING
    record.leases.finish(job.id, 1, JobState.CANCELED)
    record.delete(job.id)


def test_a_job_that_no_worker_takes_is_announced_ever_less_often(record: JobRecord, redis_url: str) -> None:
    queue = JobQueue(redis_url, "test")
    try:
        later, ordinary = accepted_elsewhere(record, LATER["a value"]), posted(record)
        looks = Reconciler(record, queue, 3, LEASE_S)
        looks._done = Paused(lambda: None)  # type: ignore[assignment]
        announced = []
        for _ in range(40):
            announced.append(looks.run_once())
            # A worker reads every message and claims what it can.
            queue._queue.empty()
            record.leases.claim_next("worker", LEASE_S)
        rounds = [number for number, each in enumerate(announced) if later.id in each]
        assert rounds == [0, 1, 3, 7, 15, 27, 39]
        assert [each for each in announced if ordinary.id in each] == announced[:1]
        # What is lost meanwhile is told at once.
        lost = posted(record)
        assert looks.run_once() == [lost.id]
    finally:
        queue.close()
