"""Estimates: known answers from jobs whose steps took a known time."""

from __future__ import annotations

import pytest

from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.models import JobState, NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest, resolve
from service.jobs.estimates import Estimate, estimate
from tests.integration.conftest import stored_file
from tests.integration.record_calls import at, claimed, posted

QUEUE = "test"


def estimated(record: JobRecord, owner_id: str = "", **request: object) -> Estimate:
    """Return the estimate for a job of ten steps, or for this request."""
    asked = JobRequest.model_validate({"prompt": "a mushroom", "params": {"steps": 10}, **request})
    places = {"default_model": "builtin", "queue": QUEUE, "owner_id": owner_id}
    return estimate(record.database, record.leases, asked, **places)


def measured(record: JobRecord, *step_s: float, **request: object) -> None:
    """Jobs that have succeeded with these seconds a step."""
    for seconds in step_s:
        job = claimed(record, posted(record, **request))
        record.leases.finish(job.id, 1, JobState.SUCCEEDED, step_s=seconds)


def waiting(record: JobRecord, steps: int, priority: int = 0) -> None:
    posted(record, params={"steps": steps}, priority=priority)


def test_nothing_is_told_before_anything_was_measured(record: JobRecord) -> None:
    job = claimed(record, posted(record))
    record.leases.finish(job.id, 1, JobState.FAILED, step_s=9.0)
    record.leases.idle(WorkerIdentity("w", QUEUE, "cpu"))
    found = estimated(record)
    assert (found.queue_s, found.run_s) == (None, None)
    assert "no job" in found.basis


def test_a_job_runs_its_steps_at_the_median_of_those_before_it(record: JobRecord) -> None:
    measured(record, 0.1, 0.2, 30.0)
    found = estimated(record)
    assert (found.run_s, found.queue_s) == (2.0, None)
    assert found.basis == "3 jobs of this kind and model; no worker is alive"
    assert estimated(record, params={"preset": "preview"}).run_s == 80 * 0.2


def test_only_the_newest_count(record: JobRecord) -> None:
    measured(record, *[9.0] * 10, *[0.5] * 50)
    assert estimated(record).run_s == 5.0


def test_other_models_count_where_nothing_closer_is_known(record: JobRecord) -> None:
    measured(record, 0.5)
    other = {"params": {"steps": 10, "guidance": {"model": "another/model"}}}
    found = estimated(record, **other)
    assert found.run_s == 5.0
    assert "other models" in found.basis
    measured(record, 2.0, **other)
    assert estimated(record, **other).run_s == 20.0
    assert estimated(record).run_s == 5.0


def test_a_job_waits_for_the_work_before_it_on_the_workers_that_are_alive(record: JobRecord) -> None:
    measured(record, 0.5)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    record.leases.idle(WorkerIdentity("elsewhere", "another", "cpu"))
    found = estimated(record)
    assert found.queue_s == 0.0
    assert found.basis == "1 job of this kind and model; 1 worker alive"
    running = claimed(record, posted(record, params={"steps": 10}))
    assert estimated(record).queue_s == 5.0
    record.leases.save_progress(running.id, 1, at(4, 10))
    assert estimated(record).queue_s == 3.0
    waiting(record, 20)
    assert estimated(record).queue_s == 13.0
    # The second worker is idle and takes the one that waits; the running job's worker is free before it.
    record.leases.idle(WorkerIdentity("w2", QUEUE, "cpu"))
    assert estimated(record).queue_s == 3.0
    record.leases.worker_ended("w2")
    # What is less urgent comes later.
    waiting(record, 100, priority=-1)
    assert estimated(record).queue_s == 13.0
    assert estimated(record, priority=-1).queue_s == 63.0
    assert estimated(record, priority=1).queue_s == 3.0


def test_owners_take_turns_in_the_estimate(record: JobRecord) -> None:
    measured(record, 1.0)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    for owner, steps in (("many", 10), ("many", 10), ("many", 10), ("other", 7)):
        posted(record, owner, params={"steps": steps})
    posted(record, "many", params={"steps": 1}, priority=1)
    # One job of each owner comes before the first of a new one, two before the second of `other`.
    assert estimated(record, "new").queue_s == 1 + 10 + 7
    assert estimated(record, "other").queue_s == 1 + 10 + 10 + 7
    assert estimated(record, "many").queue_s == 1 + 30 + 7
    assert estimated(record, "new", priority=1).queue_s == 1


def test_a_job_that_waits_counts_with_the_parameters_that_it_was_accepted_with(record: JobRecord) -> None:
    measured(record, 0.5)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    request = JobRequest.model_validate({"prompt": "a mushroom", "params": {"steps": 20}})
    resolved = resolve(request.params).model_copy(update={"steps": 6})
    record.create(NewJob(request, {"asset": stored_file()}, resolved=resolved))
    assert estimated(record).queue_s == 3.0


def test_of_many_that_wait_the_rest_counts_like_the_first(record: JobRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.jobs.estimates._COUNTED", 20)
    measured(record, 0.5)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    for _ in range(23):
        waiting(record, 4)
    assert estimated(record).queue_s == 23 * 4 * 0.5


def test_a_workers_silence_is_noticed(record: JobRecord) -> None:
    measured(record, 0.5)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    assert record.leases.alive(QUEUE) == 1
    with record.database.write() as connection:
        connection.exec_driver_sql("UPDATE workers SET seen_at = '2026-01-01 00:00:00.000000'")
    assert record.leases.alive(QUEUE) == 0
    assert estimated(record).queue_s is None
