"""Estimates: known answers from jobs whose steps, start and end took a known time."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import pytest

from meshdeform.api.documents import JobEstimate
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.models import JobState, NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.record.turns import Turns
from meshdeform.requests.document import JobRequest, resolve
from meshdeform.runs.costs import MEASURED
from service.jobs.estimates import JobSize, estimate
from tests.integration.conftest import stored_file
from tests.integration.record_calls import at, claimed, posted, set_to

QUEUE = "test"
STEPS = 10
BEGAN = datetime(2026, 1, 1, tzinfo=UTC)


def estimated(
    record: JobRecord, owner_id: str = "", faces: int | None = None, turn_s: float = math.inf, **request: object
) -> JobEstimate:
    """Return the estimate for a job of ten steps, or for this request."""
    asked = JobRequest.model_validate({"prompt": "a mushroom", "params": {"steps": STEPS}, **request})
    places = {"default_model": "builtin", "queue": QUEUE, "owner_id": owner_id}
    return estimate(record.database, record.leases, asked, **places, size=JobSize(faces), turns=Turns(turn_s))


def measured(record: JobRecord, *step_s: float, once_s: float = 0.0, **columns: object) -> None:
    """Jobs of ten steps that have succeeded with these seconds a step, and for start and end together."""
    request = columns.pop("request", {})
    assert isinstance(request, dict)
    for seconds in step_s:
        job = claimed(record, posted(record, **request))
        record.leases.finish(job.id, 1, JobState.SUCCEEDED, step_s=seconds)
        ran_s = once_s + STEPS * seconds
        set_to(record, job, **{"ran_s": ran_s, "total_steps": STEPS, **columns})


def waiting(record: JobRecord, steps: int, priority: int = 0) -> None:
    posted(record, params={"steps": steps}, priority=priority)


def test_before_anything_succeeded_the_figure_is_rough_and_says_so(record: JobRecord) -> None:
    job = claimed(record, posted(record))
    record.leases.finish(job.id, 1, JobState.FAILED, step_s=9.0)
    found = estimated(record)
    assert found.run_s == pytest.approx(MEASURED["text_deform/sds"].seconds(None, None, None).of(STEPS))
    assert found.queue_s is None
    assert found.basis.startswith("no job of this kind has succeeded here yet: a rough figure")


def test_nothing_is_told_of_models_and_kinds_that_were_never_measured(record: JobRecord) -> None:
    record.leases.idle(WorkerIdentity("w", QUEUE, "cpu"))
    for request in ({"params": {"guidance": {"model": "another/model"}}}, {"kind": "family_fit", "params": {}}):
        found = estimated(record, **request)
        assert (found.queue_s, found.run_s) == (None, None)
        assert found.basis == "no job of this kind has succeeded here yet"


def test_a_job_runs_its_steps_and_the_rest_at_the_median_of_those_before_it(record: JobRecord) -> None:
    measured(record, 0.1, 0.2, 30.0, once_s=3.0)
    found = estimated(record)
    assert (found.run_s, found.queue_s) == (pytest.approx(2.0 + 3.0), None)
    assert found.not_resumable_s == pytest.approx(3.0)
    assert found.basis == "3 jobs of this kind and model; no worker is alive"
    assert estimated(record, params={"preset": "preview"}).run_s == pytest.approx(60 * 0.2 + 3.0)


def test_ten_times_the_faces_take_as_much_longer_as_they_cost(record: JobRecord) -> None:
    measured(record, 0.2, once_s=3.0, faces=20_000)
    costs = MEASURED["text_deform/sds"]
    for faces in (20_000, 200_000):
        once = 3.0 * costs.seconds(faces, 1, None).once / costs.seconds(20_000, 1, None).once
        assert estimated(record, faces=faces).run_s == pytest.approx(STEPS * 0.2 + once)
    assert estimated(record, faces=200_000).run_s == pytest.approx(2.0 + 3.0 * 5.9, rel=0.05)


def test_waits_between_attempts_and_jobs_that_continue_another_do_not_count(record: JobRecord) -> None:
    measured(record, 0.2, once_s=3.0, attempt=2, started_at=BEGAN)
    measured(record, 0.2, ran_s=0.0, started_at=BEGAN, finished_at=BEGAN + timedelta(seconds=2.0 + 3.0))
    measured(record, 90.0, once_s=90.0, origin={"job_id": "job_1", "step": 3, "mode": "retry"})
    assert estimated(record).run_s == pytest.approx(2.0 + 3.0)


def test_only_the_newest_count(record: JobRecord) -> None:
    measured(record, *[9.0] * 10, *[0.5] * 50)
    assert estimated(record).run_s == pytest.approx(5.0)


def test_other_models_count_where_nothing_closer_is_known(record: JobRecord) -> None:
    measured(record, 0.5)
    other = {"params": {"steps": STEPS, "guidance": {"model": "another/model"}}}
    found = estimated(record, **other)
    assert found.run_s == pytest.approx(5.0)
    assert "other models" in found.basis
    measured(record, 2.0, request=other)
    assert estimated(record, **other).run_s == pytest.approx(20.0)
    assert estimated(record).run_s == pytest.approx(5.0)


def test_a_job_waits_for_the_work_before_it_on_the_workers_that_are_alive(record: JobRecord) -> None:
    measured(record, 0.5)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    record.leases.idle(WorkerIdentity("elsewhere", "another", "cpu"))
    found = estimated(record)
    assert found.queue_s == 0.0
    assert found.basis == "1 job of this kind and model; 1 worker alive"
    running = claimed(record, posted(record, params={"steps": 10}))
    assert estimated(record).queue_s == pytest.approx(5.0)
    record.leases.save_progress(running.id, 1, at(4, 10))
    assert estimated(record).queue_s == pytest.approx(3.0)
    waiting(record, 20)
    assert estimated(record).queue_s == pytest.approx(13.0)
    # The second worker is idle and takes the one that waits; the running job's worker is free before it.
    record.leases.idle(WorkerIdentity("w2", QUEUE, "cpu"))
    assert estimated(record).queue_s == pytest.approx(3.0)
    record.leases.worker_ended("w2")
    # What is less urgent comes later.
    waiting(record, 100, priority=-1)
    assert estimated(record).queue_s == pytest.approx(13.0)
    assert estimated(record, priority=-1).queue_s == pytest.approx(63.0)
    assert estimated(record, priority=1).queue_s == pytest.approx(3.0)


def test_each_job_ahead_counts_at_the_pace_of_its_own_kind_and_mesh(record: JobRecord) -> None:
    measured(record, 1.0, once_s=4.0, faces=1_000)
    target = {"params": {"steps": STEPS, "guidance": {"kind": "target"}}}
    measured(record, 3.0, once_s=4.0, faces=1_000, request=target)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    set_to(record, posted(record, **target), faces=1_000)
    assert estimated(record, faces=1_000).queue_s == pytest.approx(34.0)
    running = claimed(record, set_to(record, posted(record, params={"steps": STEPS}), faces=1_000))
    record.leases.save_progress(running.id, 1, at(6, STEPS))
    assert estimated(record, faces=1_000).queue_s == pytest.approx(34.0 + 4 * 1.0 + 3.0)


def test_owners_take_turns_in_the_estimate(record: JobRecord) -> None:
    measured(record, 1.0)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    for owner, steps in (("many", 10), ("many", 10), ("many", 10), ("other", 7)):
        posted(record, owner, params={"steps": steps})
    posted(record, "many", params={"steps": 1}, priority=1)
    # One job of each owner comes before the first of a new one, two before the second of `other`.
    assert estimated(record, "new").queue_s == pytest.approx(1 + 10 + 7)
    assert estimated(record, "other").queue_s == pytest.approx(1 + 10 + 10 + 7)
    assert estimated(record, "many").queue_s == pytest.approx(1 + 30 + 7)
    assert estimated(record, "new", priority=1).queue_s == pytest.approx(1)


def test_a_job_of_another_owner_is_in_the_way_for_a_turn_at_most(record: JobRecord) -> None:
    measured(record, 1.0)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    claimed(record, posted(record, "long", params={"steps": 5000}))
    posted(record, "long", params={"steps": 5000})
    assert estimated(record, "short", turn_s=300.0).queue_s == pytest.approx(600.0)
    assert estimated(record, "long", turn_s=300.0).queue_s == pytest.approx(10_000.0)


def test_a_job_that_waits_counts_with_the_parameters_that_it_was_accepted_with(record: JobRecord) -> None:
    measured(record, 0.5)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    request = JobRequest.model_validate({"prompt": "a mushroom", "params": {"preset": "paper", "steps": 20}})
    resolved = resolve(request.params).model_copy(update={"steps": 6})
    record.create(NewJob(request, {"asset": stored_file()}, resolved=resolved))
    assert estimated(record).queue_s == pytest.approx(3.0)


def test_of_many_that_wait_the_rest_counts_like_the_first(record: JobRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.jobs.estimates._COUNTED", 20)
    measured(record, 0.5)
    record.leases.idle(WorkerIdentity("w1", QUEUE, "cpu"))
    for _ in range(23):
        waiting(record, 4)
    assert estimated(record).queue_s == pytest.approx(23 * 4 * 0.5)
