"""One attempt ends in exactly one way, on a real record and a real store, with a fake kind that takes no time."""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from meshdeform.errors import NumericalError
from meshdeform.record.models import Job, JobState, NewJob
from meshdeform.record.schema import jobs
from meshdeform.requests.document import resolve
from meshdeform.runs.base import InputFile, JobRun, RunInput
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.worker_world import STEPS, World, new_world


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with new_world(tmp_path) as world:
        yield world


def test_a_job_succeeds_with_its_results_and_its_checkpoints(world: World) -> None:
    job = world.run(world.create())
    assert (job.state, job.attempt, job.error) == (JobState.SUCCEEDED, 1, None)
    (artifact,) = world.record.artifacts(job.id)
    data = world.store.get(artifact.key)
    assert (artifact.size, artifact.sha256) == (len(data), hashlib.sha256(data).hexdigest())
    assert artifact.key == f"jobs/{job.id}/1/result.glb"
    assert (job.progress.step, job.progress.fraction) == (STEPS, 1.0)
    assert world.kept(job) == [40, 30, 20, 10]
    (given,) = world.kind.started
    file = InputFile(b"an asset", "a.glb", hashlib.sha256(b"an asset").hexdigest())
    assert given.files == {"asset": file, "target": file}


def test_a_run_gets_the_parameters_as_they_were_resolved_at_the_door(world: World) -> None:
    job = world.run(world.create())
    resolved = resolve(job.request.params)
    world.run(world.record.create(NewJob(job.request, job.files, resolved=resolved)))
    before, after = world.kind.started
    assert before.resolved is None
    assert after.resolved == resolved.model_dump(mode="json")


def test_a_kind_that_needs_a_prior_loads_it_through_the_worker(world: World) -> None:
    world.run(world.create())
    assert world.priors == []
    world.run(world.create(guidance="sds"))
    assert world.priors == ["builtin"]


def test_a_duplicate_delivery_does_nothing(world: World) -> None:
    job = world.run(world.create())
    assert world.run(job) == job
    assert len(world.kind.started) == 1


def test_an_expected_error_fails_the_job_with_its_code_and_advice(world: World) -> None:
    def fail(step: int) -> None:
        raise NumericalError("The loss is not finite.", advice="Try less.")

    world.kind.on_step = fail
    job = world.run(world.create())
    assert job.state is JobState.FAILED
    assert job.error is not None
    assert (job.error.code, job.error.detail, job.error.advice) == (
        "numerical_failure",
        "The loss is not finite.",
        "Try less.",
    )


def test_an_unforeseen_error_is_internal_and_tells_only_the_log(world: World, caplog: pytest.LogCaptureFixture) -> None:
    def fail(step: int) -> None:
        raise OSError(28, "No space left on device", "/secret/path")

    world.kind.on_step = fail
    with caplog.at_level(logging.ERROR):
        job = world.run(world.create())
    assert job.state is JobState.FAILED
    assert job.error is not None
    assert job.error.code == "internal"
    assert "secret" not in job.error.model_dump_json()
    assert "/secret/path" in caplog.text


def test_a_cancel_stops_the_job(world: World) -> None:
    job = world.create(steps=50_000)
    world.kind.on_step = lambda step: world.record.request_cancel(job.id) and None if step == 5 else None
    # The channel is deaf here: the record alone must be enough, at the next heartbeat.
    world.runner(settings=Settings(lease_s=1.0)).run(job.id)
    job = world.record.get(job.id)
    assert job.state is JobState.CANCELED
    assert world.record.artifacts(job.id) == []


@pytest.mark.parametrize(("stop", "state"), [("cancel", JobState.CANCELED), ("shutdown", JobState.QUEUED)])
def test_a_start_that_takes_long_hears_that_it_must_stop(world: World, stop: str, state: JobState) -> None:
    job = world.create()

    def start(given: RunInput) -> JobRun:
        if stop == "cancel":
            world.record.request_cancel(job.id)
        else:
            world.stop = True
        until_at = time.monotonic() + 30
        while time.monotonic() < until_at:
            given.on_wait()
        raise AssertionError("nothing stopped the start")

    # As above, the record alone must be enough for a cancel.
    world.runner(start=start, settings=Settings(lease_s=1.0)).run(job.id)
    assert world.record.get(job.id).state is state


def test_a_cancel_during_the_last_step_still_cancels(world: World) -> None:
    job = world.create()
    world.kind.on_step = lambda step: world.record.request_cancel(job.id) and None if step == STEPS else None
    assert world.run(job).state is JobState.CANCELED


def test_a_stopping_worker_hands_the_job_back_after_its_step(world: World) -> None:
    whole = world.create()
    world.run(whole)

    job = world.create()
    world.kind.on_step = lambda step: setattr(world, "stop", step == 17)
    handed_back = world.run(job)
    assert (handed_back.state, handed_back.attempt) == (JobState.QUEUED, 1)
    assert world.kept(job) == [17, 10]

    world.stop, world.kind.on_step = False, lambda step: None
    done = world.run(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 2)
    assert world.kind.started_at == [0, 0, 17]
    assert world.result(job) == world.result(whole)


def test_a_job_handed_back_after_its_last_step_only_finishes(world: World) -> None:
    job = world.create()
    world.kind.on_step = lambda step: setattr(world, "stop", step == STEPS)
    assert world.run(job).state is JobState.QUEUED
    world.stop = False
    assert world.run(job).state is JobState.SUCCEEDED
    assert world.kind.started_at == [0, STEPS]


def lose(world: World, job: Job, at: int) -> None:
    """Let the attempt end as if its process were killed in a step, and its lease run out."""

    def die(step: int) -> None:
        if step == at:
            raise KeyboardInterrupt

    world.kind.on_step = die
    with pytest.raises(KeyboardInterrupt):
        world.runner().run(job.id)
    world.kind.on_step = lambda step: None
    world.expire(job)
    assert world.record.upkeep.reclaim_expired(3) == [job.id]


def test_a_lost_attempt_is_resumed_from_the_last_checkpoint(world: World) -> None:
    whole = world.create()
    world.run(whole)
    job = world.create()
    lose(world, job, at=35)
    done = world.run(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 2)
    assert world.kind.started_at == [0, 0, 30]
    assert world.result(job) == world.result(whole)


@each_case(("damaged", "resumed_at"), [([0], 20), ([0, 1], 10), ([0, 1, 2], 0)])
@each_case("damage", ["torn", "gone"])
def test_a_torn_checkpoint_falls_back_to_the_one_before(
    world: World, damaged: list[int], resumed_at: int, damage: str
) -> None:
    job = world.create()
    lose(world, job, at=35)
    references = world.record.leases.checkpoints(job.id)
    for index in damaged:
        if damage == "gone":
            world.store.delete(references[index].key)
        else:
            data = world.store.get(references[index].key)
            world.store.put(references[index].key, data[:-3], "application/octet-stream")
    assert world.run(job).state is JobState.SUCCEEDED
    assert world.kind.started_at[-1] == resumed_at


def test_a_checkpoint_that_the_kind_refuses_is_passed_over(world: World) -> None:
    job = world.create()
    lose(world, job, at=35)
    claimed = world.record.leases.claim(job.id, "another", 30.0)
    assert claimed is not None
    data = b"whole, but of another format"
    world.store.put("jobs/x", data, "application/octet-stream")
    world.record.leases.set_checkpoint(
        job.id, claimed.attempt, key="jobs/x", step=40, sha256=hashlib.sha256(data).hexdigest()
    )
    world.record.leases.release(job.id, claimed.attempt)
    assert world.run(job).state is JobState.SUCCEEDED
    assert world.kind.started_at[-1] == 30


def test_an_attempt_that_lost_its_lease_writes_nothing_more(world: World) -> None:
    job = world.create(steps=50_000)

    def usurp(step: int) -> None:
        if step == 15:
            world.expire(job)
            assert world.record.upkeep.reclaim_expired(3) == [job.id]
            assert world.record.leases.claim(job.id, "another", 30.0) is not None

    world.kind.on_step = usurp
    world.runner(settings=Settings(lease_s=1.0)).run(job.id)
    left = world.record.get(job.id)
    assert (left.state, left.attempt, left.error) == (JobState.RUNNING, 2, None)
    assert world.record.artifacts(job.id) == []


def test_only_so_many_checkpoints_stay_and_each_has_its_mesh(world: World) -> None:
    job = world.create()
    world.runner(settings=Settings(checkpoints_kept=2)).run(job.id)
    references = world.record.leases.checkpoints(job.id)
    assert [reference.step for reference in references] == [40, 30]
    for reference in references:
        data = world.store.get(reference.key)
        assert (reference.size, reference.sha256) == (len(data), hashlib.sha256(data).hexdigest())
        assert reference.key == f"jobs/{job.id}/1/checkpoint-{reference.step:06d}"
        assert reference.mesh_key == f"{reference.key}.glb"
        assert hashlib.sha256(world.store.get(reference.mesh_key)).hexdigest() == reference.mesh_sha256
    left = {key.rpartition("/")[2] for key, _ in world.store.list(f"jobs/{job.id}/")}
    assert left == {f"checkpoint-0000{n}0{end}" for n in (3, 4) for end in ("", ".glb")} | {"result.glb"}


def test_a_mesh_that_cannot_be_written_costs_no_checkpoint(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(run: Any) -> Any:
        raise NumericalError("The shape is not finite.")

    monkeypatch.setattr("tests.fake_kind._FakeRun.snapshot", broken)
    job = world.create()
    world.kind.on_step = lambda step: setattr(world, "stop", step == 17)
    assert world.run(job).state is JobState.QUEUED
    assert [(each.step, each.mesh_key) for each in world.record.leases.checkpoints(job.id)] == [(17, None), (10, None)]


def test_the_most_urgent_job_comes_first_whichever_was_told(world: World) -> None:
    usual = world.create()
    urgent = world.create(priority=5)
    world.runner().run(usual.id)
    assert world.record.get(urgent.id).state is JobState.SUCCEEDED
    assert world.record.get(usual.id).state is JobState.QUEUED


def test_a_job_that_only_another_version_can_read_is_left_to_it(world: World) -> None:
    later, ordinary = world.create(priority=5), world.create()
    with world.record.database.write() as connection:
        change = sa.update(jobs).where(jobs.c.id == later.id)
        connection.execute(change.values(request={**later.document, "params": {"wobble": 0.5}}))
    # Whichever job a message names.
    assert world.run(later).state is JobState.QUEUED
    assert world.record.get(ordinary.id).state is JobState.SUCCEEDED
    assert world.run(later).version == later.version
    assert len(world.kind.started) == 1


def test_a_deadline_that_passes_stops_the_run_and_the_next_job_begins(world: World) -> None:
    job, steps = world.create(steps=50_000, checkpoint_every_steps=50_000, deadline_s=60.0), []

    def expire(step: int) -> None:
        steps.append(step)
        if step == 15:
            with world.record._database.write() as connection:
                connection.execute(sa.update(jobs).where(jobs.c.id == job.id).values(deadline_at=jobs.c.created_at))
            assert world.record.upkeep.expire_deadlines() == [job.id]
        time.sleep(0.001)

    world.kind.on_step = expire
    assert world.run(job).state is JobState.EXPIRED
    assert 15 <= len(steps) < 50_000
    assert world.record.artifacts(job.id) == []
    world.kind.on_step = lambda step: None
    assert world.run(world.create()).state is JobState.SUCCEEDED
