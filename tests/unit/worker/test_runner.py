"""One attempt ends in exactly one way, on a real record and a real store, with a fake kind that takes no time."""

from __future__ import annotations

import hashlib
import json
import logging
import re
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import sqlalchemy as sa

from meshdeform.errors import CheckpointError, DependencyError, MeshdeformError, ModelError, NumericalError
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.models import EventType, Job, JobState, NewJob, Origin, OriginMode, StoredFile
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import jobs, workers
from meshdeform.record.turns import Turns
from meshdeform.requests.document import JobRequest, resolve
from meshdeform.runs import start_run
from meshdeform.runs.base import ArtifactData, InputFile, JobRun, RunInput
from meshdeform.settings import Settings
from meshdeform.support.sources import build, digest_of
from tests.cases import each_case
from tests.claims import claim_job
from tests.fake_kind import OutOfMemoryError
from tests.unit.plain.shapes import chair, plain_glb
from tests.worker_world import STEPS, World, away, fail_for_a_while, new_world
from worker.attempt import is_out_of_memory


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
    assert given.resolved is None
    assert world.priors == []
    # The parameters as they were resolved at the door, and a prior where the kind needs one.
    resolved = resolve(job.request.params)
    world.run(world.record.create(NewJob(job.request, job.files, resolved=resolved)))
    assert world.kind.started[-1].resolved == resolved.model_dump(mode="json")
    world.run(world.create(guidance="sds"))
    assert world.priors == ["builtin"]


def test_a_duplicate_delivery_does_nothing(world: World) -> None:
    job = world.run(world.create())
    assert world.run(job) == job
    assert len(world.kind.started) == 1


def test_results_and_reports_name_the_versions_that_computed_them(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = ArtifactData(b'{"warnings": ["a"]}', "application/json")
    monkeypatch.setattr("tests.fake_kind._FakeRun.finish", lambda run: {"report.json": report})
    plain = world.run(world.create())
    assert plain.made_by == build()
    assert re.fullmatch(r"\d+\.\d+\.\d+\+[0-9a-f]{8}", build())
    assert len({digest_of([name]) for name in ("", "words", "reading/version.py", "support/sources.py")}) == 4
    assert json.loads(world.result(plain)) == {"warnings": ["a"]}
    job = world.create()
    monkeypatch.setattr("worker.attempt.build", lambda: "0.0.9")
    lose(world, job, 25)
    assert {each.made_by for each in world.record.leases.checkpoints(job.id)} == {"0.0.9"}
    monkeypatch.setattr("worker.attempt.build", lambda: "0.1.0")
    lose(world, job, 35)
    monkeypatch.setattr("worker.attempt.build", lambda: "0.1.1")
    done = world.run(job)
    assert done.made_by == "0.0.9, 0.1.0, 0.1.1"
    told = json.loads(world.result(done))
    assert told["made_by"] == ["0.0.9", "0.1.0", "0.1.1"]
    assert "computed by Meshdeform 0.0.9, then 0.1.0, then 0.1.1" in told["warnings"][1]
    last = world.record.leases.checkpoints(job.id)[0]
    made_by = last.made_by or ""
    origin = Origin(
        job_id=job.id, step=last.step, mode=OriginMode.RETRY, key=last.key, sha256=last.sha256, made_by=made_by
    )
    assert world.run(world.create(origin=origin)).made_by == "0.0.9, 0.1.0, 0.1.1"


@each_case("error", [DependencyError("There is no torch here."), ModelError("There is no such model here.")])
def test_what_this_worker_lacks_another_one_may_have(world: World, error: MeshdeformError) -> None:
    world.kind.on_step = raising(error)
    alone = world.run(world.create())
    assert (alone.state, alone.error and alone.error.code) == (JobState.FAILED, error.code)
    for name in ("a worker", "another worker"):
        world.record.leases.idle(WorkerIdentity(name, "meshdeform", "cpu"))
    job = world.create()
    world.runner(settings=Settings(retry_delay_s=0)).run(job.id)
    waiting = world.record.get(job.id)
    assert (waiting.state, waiting.error and waiting.error.code) == (JobState.QUEUED, error.code)
    world.kind.on_step = lambda step: None
    world.run(job)  # not this one
    assert world.record.get(job.id).attempt == 1
    with closing(JobRecord(world.record.database._engine.url.render_as_string())) as other:
        claimed = other.leases.claim_next("another worker", 60.0)
    assert claimed is not None
    assert claimed.id == job.id
    with world.record.database.write() as connection:
        connection.execute(sa.delete(workers))
        connection.execute(sa.update(jobs).where(jobs.c.id == job.id).values(state=JobState.CANCELED))


def raising(error: Exception) -> Any:
    """Return what raises it in a step."""

    def fail(step: int) -> None:
        raise error

    return fail


def test_an_error_fails_the_job_with_its_code_or_as_an_internal_one_that_tells_only_the_log(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    world.kind.on_step = raising(NumericalError("The loss is not finite.", advice="Try less."))
    expected = world.run(world.create())
    assert expected.state is JobState.FAILED
    assert expected.error is not None
    assert (expected.error.code, expected.error.detail) == ("numerical_failure", "The loss is not finite.")
    assert expected.error.advice == "Try less."
    world.kind.on_step = raising(OSError(28, "No space left on device", "/secret/path"))
    with caplog.at_level(logging.ERROR):
        job = world.create()
        for state in (JobState.QUEUED, JobState.QUEUED, JobState.FAILED):
            world.runner(settings=Settings(retry_delay_s=0)).run(job.id)
            assert world.record.get(job.id).state is state
    job = world.record.get(job.id)
    assert job.error is not None
    assert job.error.code == "internal"
    assert "secret" not in job.error.model_dump_json()
    assert "/secret/path" in caplog.text


def test_a_failure_that_may_pass_is_tried_again_later_and_goes_on_from_its_checkpoint(world: World) -> None:
    failing = [25, 45]

    def fail(step: int) -> None:
        if step in failing:
            failing.remove(step)
            raise OSError(116, "Stale file handle")

    world.kind.on_step = fail
    job = world.create()
    world.run(job)
    waiting = world.record.get(job.id)
    assert (waiting.state, waiting.attempt, waiting.error and waiting.error.code) == (JobState.QUEUED, 1, "internal")
    assert waiting.retry_at is not None
    assert 5 < (waiting.retry_at - waiting.created_at).total_seconds() < 600
    event = world.record.events.after(job.id)[-1]
    assert (event.type, event.data["reason"], event.data["error"]["code"]) == (EventType.QUEUED, "failure", "internal")
    # Nobody takes it before, and nobody else waits for it.
    assert world.run(job).attempt == 1
    assert world.record.upkeep.queued_ids(9) == []
    soon = Settings(retry_delay_s=0)
    with world.record.database.write() as connection:
        connection.execute(sa.update(jobs).values(retry_at=world.record.database.now()))
    world.runner(settings=soon).run(job.id)
    assert world.record.get(job.id).state is JobState.QUEUED
    world.runner(settings=soon).run(job.id)
    done = world.record.get(job.id)
    assert (done.state, done.attempt, done.error, done.retry_at) == (JobState.SUCCEEDED, 3, None, None)
    assert world.kind.started_at == [0, 20, 40]
    plain = world.create()
    world.kind.on_step = lambda step: None
    assert world.result(world.run(plain)) == world.result(done)


@each_case(("steps", "at"), [(50_000, 5), (STEPS, STEPS)], ids=["early", "in the last step"])
def test_a_cancel_stops_the_job(world: World, steps: int, at: int) -> None:
    job = world.create(steps=steps)
    world.kind.on_step = lambda step: world.record.request_cancel(job.id) and None if step == at else None
    # The channel is deaf here: the record alone must be enough, at the next heartbeat.
    world.runner(settings=Settings(lease_s=1.0)).run(job.id)
    job = world.record.get(job.id)
    assert job.state is JobState.CANCELED
    assert world.record.artifacts(job.id) == []


STOPS = [("cancel", JobState.CANCELED), ("shutdown", JobState.QUEUED)]


@pytest.mark.parametrize(("stop", "state"), STOPS)
def test_a_start_that_takes_long_hears_that_it_must_stop(world: World, stop: str, state: JobState) -> None:
    job = world.create()

    def start(given: RunInput) -> JobRun:
        ask_to_stop(world, job, stop)
        return waits(given)

    # As above, the record alone must be enough for a cancel.
    world.runner(start=start, settings=Settings(lease_s=1.0)).run(job.id)
    assert world.record.get(job.id).state is state


def waits(given: RunInput) -> JobRun:
    """Start for ever, or until it is told to stop."""
    until_at = time.monotonic() + 240
    while time.monotonic() < until_at:
        given.on_wait()
    raise AssertionError("nothing stopped the start")


def test_the_time_of_a_job_is_over_also_while_it_starts(world: World) -> None:
    job = world.create()
    world.runner(start=waits, settings=Settings(max_run_s=0.5)).run(job.id)
    failed = world.record.get(job.id)
    assert failed.error is not None
    assert (failed.state, failed.error.code) == (JobState.FAILED, "run_time_exceeded")
    assert failed.error.detail == "The job has run for the 0.5 s that it may run, and was loading."


def test_a_start_makes_room_and_has_twice_as_long_each_time(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Turns, "of", lambda settings: Turns(0.2))
    job, others = world.create(), []

    def may_start(later_s: float) -> None:
        with world.record.database.write() as connection:
            other = sa.update(jobs).where(jobs.c.id == others[-1].id)
            connection.execute(other.values(retry_at=world.record.database.now(later_s)))

    def start(given: RunInput) -> JobRun:
        if given.request.priority:
            return world.kind.start(given)
        may_start(-1.0)
        return waits(given)

    for turns in range(3):
        assert world.record.leases.fruitless(world.record.get(job.id)) == turns
        others.append(world.create(priority=1))
        may_start(86_400.0)  # so that it is not taken first
        began = time.monotonic()
        world.runner(start=start, settings=Settings(lease_s=1.0)).run(job.id)
        taken_s = time.monotonic() - began
        assert taken_s >= 0.2 * 2**turns
    assert [world.record.get(each.id).state for each in others] == [JobState.SUCCEEDED] * 3


@each_case(("at", "kept"), [(17, [17, 10]), (STEPS, [50, 40, 30, 20, 10])])
def test_a_stopping_worker_hands_the_job_back_after_its_step(world: World, at: int, kept: list[int]) -> None:
    whole = world.create()
    world.run(whole)
    job = world.create()
    world.kind.on_step = lambda step: setattr(world, "stop", step == at)
    handed_back = world.run(job)
    assert (handed_back.state, handed_back.attempt) == (JobState.QUEUED, 1)
    assert world.kept(job) == kept
    world.stop, world.kind.on_step = False, lambda step: None
    done = world.run(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 2)
    assert world.kind.started_at[-1] == at
    assert world.result(job) == world.result(whole)


def test_a_job_makes_room_for_one_that_has_waited_and_goes_on_after_it(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = world.create()
    world.run(whole)
    monkeypatch.setattr(Turns, "of", lambda settings: Turns(0.0))
    long, urgent = world.create(checkpoint_every_steps=1000), []

    def step(number: int) -> None:
        if number == 17 and not urgent:
            urgent.append(world.create(priority=1))
        time.sleep(0.02 if urgent else 0.0)

    world.kind.on_step = step
    # One message is enough for both.
    world.runner(settings=Settings(lease_s=1.0)).run(long.id)
    assert world.record.get(urgent[0].id).state is JobState.SUCCEEDED
    waiting = world.record.get(long.id)
    assert (waiting.state, waiting.attempt, waiting.progress.phase) == (JobState.QUEUED, 1, "queued")
    assert world.record.events.after(long.id)[-1].data["reason"] == "handed_over"
    world.kind.on_step = lambda step: None
    done = world.run(long)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 2)
    assert 17 <= world.kind.started_at[-1] < STEPS
    assert world.result(done) == world.result(whole)


def test_a_worker_takes_the_next_job_of_an_owner_that_runs_as_many_as_it_may(world: World) -> None:
    mine = [world.create() for _ in range(2)]
    # The message of the other one may have been read while it could not start.
    world.runner(settings=Settings(max_running_jobs=1)).run(mine[0].id)
    assert [world.record.get(job.id).state for job in mine] == [JobState.SUCCEEDED] * 2


@pytest.mark.parametrize(("settings", "own"), [({"max_run_s": 60.0}, None), ({}, 60.0), ({"max_run_s": 90.0}, 60.0)])
def test_a_job_that_runs_for_too_long_fails_with_a_checkpoint(
    world: World, monkeypatch: pytest.MonkeyPatch, settings: dict[str, float], own: float | None
) -> None:
    now = [1000.0]
    monkeypatch.setattr("worker.attempt.time", SimpleNamespace(monotonic=lambda: now[0]))
    job = world.create(max_run_s=own)
    with world.record.database.write() as connection:
        connection.execute(sa.update(jobs).where(jobs.c.id == job.id).values(ran_s=40.0))
    world.kind.on_step = lambda step: now.append(now.pop() + 1.2)
    world.runner(settings=Settings(**settings)).run(job.id)
    failed = world.record.get(job.id)
    assert failed.error is not None
    assert (failed.state, failed.error.code) == (JobState.FAILED, "run_time_exceeded")
    assert failed.error.detail == "The job has run for the 60 s that it may run, and done 17 of 50 steps."
    assert world.kept(job) == [17, 10]
    # A retry goes on from there and may run for as long again.
    last = world.record.leases.checkpoints(job.id)[0]
    origin = Origin(job_id=job.id, step=17, mode=OriginMode.RETRY, key=last.key, sha256=last.sha256)
    again = world.create(max_run_s=own, origin=origin)
    world.runner(settings=Settings(**settings)).run(again.id)
    assert world.record.get(again.id).state is JobState.SUCCEEDED
    assert world.kind.started_at == [0, 17]


def test_a_job_that_is_through_when_its_time_is_over_succeeds(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [1000.0]
    monkeypatch.setattr("worker.attempt.time", SimpleNamespace(monotonic=lambda: now[0]))
    world.kind.on_step = lambda step: now.append(now.pop() + 1.2)
    job = world.create(steps=1)
    world.runner(settings=Settings(max_run_s=1.0)).run(job.id)
    assert world.record.get(job.id).state is JobState.SUCCEEDED


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


@each_case(("damaged", "resumed_at"), [([], 30), ([0], 20), ([0, 1], 10), ([0, 1, 2], 0)])
@each_case("damage", ["torn", "gone", "foreign"])
def test_a_torn_checkpoint_falls_back_to_the_one_before(
    world: World, damaged: list[int], resumed_at: int, damage: str
) -> None:
    whole_job, job = world.create(), world.create()
    world.run(whole_job)
    lose(world, job, at=35)
    references = world.record.leases.checkpoints(job.id)
    whole = [world.store.get(reference.key) for reference in references]
    for index in damaged:
        if damage == "gone":
            world.store.delete(references[index].key)
        else:
            other = whole[index][:-3] if damage == "torn" else whole[index - 1]
            world.store.put(references[index].key, other, "application/octet-stream")
    done = world.run(job)
    assert (done.state, done.attempt, world.kind.started_at[-1]) == (JobState.SUCCEEDED, 2, resumed_at)
    assert world.result(job) == world.result(whole_job)


def test_a_checkpoint_that_the_kind_refuses_is_passed_over(world: World) -> None:
    job = world.create()
    lose(world, job, at=35)
    claimed = claim_job(world.record.leases, job.id, "another", 30.0)
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
            assert claim_job(world.record.leases, job.id, "another", 30.0) is not None

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


# A device without memory: what was done is saved, the process ends for a clean context, and not without end.


def run_out(world: World, job: Job, at: int) -> Job:
    """Run the job to a step that finds no memory."""

    def fail(step: int) -> None:
        if step == at:
            raise OutOfMemoryError("CUDA out of memory.")

    world.kind.on_step = fail
    return world.run(job)


def test_the_state_before_the_step_is_stored_and_the_process_ends(world: World) -> None:
    whole = world.create()
    world.run(whole)
    job = world.create()
    left = run_out(world, job, at=17)
    assert (left.state, left.attempt, left.oom_attempts) == (JobState.QUEUED, 1, 1)
    assert world.kept(job) == [16, 10]
    assert world.renewals == ["now"]
    world.kind.on_step = lambda step: None
    assert world.run(job).state is JobState.SUCCEEDED
    assert world.kind.started_at == [0, 0, 16]
    assert world.result(job) == world.result(whole)


def test_it_may_come_before_the_first_step(world: World) -> None:
    job = world.create(guidance="sds")

    def load(model: str) -> Any:
        raise ModelError("The model cannot be loaded.") from OutOfMemoryError("CUDA out of memory.")

    world.runner(load_prior=load).run(job.id)
    left = world.record.get(job.id)
    assert (left.state, left.oom_attempts, world.renewals) == (JobState.QUEUED, 1, ["now"])
    # As torch and CUDA say it; the machine's own memory is another matter.
    assert is_out_of_memory(RuntimeError("CUDA error: out of memory\nCUDA kernel errors might be"))
    assert not any(map(is_out_of_memory, (MemoryError(), RuntimeError("no memory of it"), None)))


# A job that continues another one: a retry ends as if never interrupted, a branch begins with its shape.


def continued(world: World, mode: OriginMode, data: bytes | None, **params: Any) -> Job:
    """A job with an origin, whose checkpoint is stored; without one where there are no bytes."""
    sha256 = hashlib.sha256(data).hexdigest() if data is not None else ""
    key = f"assets/{sha256}" if data is not None else ""
    if data is not None:
        world.store.put(key, data)
    return world.create(origin=Origin(job_id="job_before", step=30, mode=mode, key=key, sha256=sha256), **params)


def state(world: World) -> tuple[bytes, bytes]:
    """The checkpoint of step 30 of an uninterrupted run, and that run's result."""
    whole = world.create()
    world.run(whole)
    (key,) = [each.key for each in world.record.leases.checkpoints(whole.id) if each.step == 30]
    return world.store.get(key), world.result(whole)


def test_a_retry_goes_on_from_the_checkpoint_to_the_same_bytes(world: World) -> None:
    data, result = state(world)
    job = continued(world, OriginMode.RETRY, data)
    # Its own checkpoints come first.
    world.kind.on_step = lambda step: setattr(world, "stop", step == 44)
    world.run(job)
    world.stop, world.kind.on_step = False, lambda step: None
    assert world.run(job).state is JobState.SUCCEEDED
    assert world.kind.started_at[-2:] == [30, 44]
    assert world.result(job) == result


def test_a_retry_without_one_or_with_a_torn_one_begins_anew(world: World) -> None:
    data, result = state(world)
    torn = continued(world, OriginMode.RETRY, data)
    assert torn.origin is not None
    world.store.put(torn.origin.key, data[:-2])
    for job in (torn, continued(world, OriginMode.RETRY, None)):
        assert world.run(job).state is JobState.SUCCEEDED
        assert world.kind.started_at[-1] == 0
        assert world.result(job) == result


def test_a_branch_begins_with_the_shape_at_step_0(world: World) -> None:
    data, result = state(world)
    job = continued(world, OriginMode.BRANCH, data, steps=5)
    assert world.run(job).state is JobState.SUCCEEDED
    given = world.kind.started[-1]
    assert (given.checkpoint, given.initial, world.kind.started_at[-1]) == (None, data, 0)
    value = json.loads(data)["value"]
    for step in range(1, 6):
        value = value * 3 + step
    assert world.result(job) == str(value).encode() != result


def test_a_branch_without_its_shape_fails(world: World) -> None:
    data, _ = state(world)
    job = continued(world, OriginMode.BRANCH, data)
    assert job.origin is not None
    world.store.delete(job.origin.key)
    done = world.run(job)
    assert done.error is not None
    assert (done.state, done.error.code) == (JobState.FAILED, CheckpointError.code)


# While the store or the record is away, an attempt waits: it throws nothing away and hears what it is told.


def _part(world: World, name: str) -> Any:
    return world.store if name == "store" else getattr(world.record, name)


def test_a_store_that_is_away_for_good_leaves_the_job_to_the_next_attempt(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = world.create()
    with monkeypatch.context() as patch:
        patch.setattr(world.store, "put", away)
        world.runner(retry_for_s=0.3).run(job.id)
    left = world.record.get(job.id)
    assert (left.state, left.attempt, world.record.artifacts(job.id)) == (JobState.QUEUED, 1, [])
    assert world.run(job).state is JobState.SUCCEEDED


@pytest.mark.parametrize(
    ("part", "method"),
    [("store", "get"), ("store", "put"), ("leases", "checkpoints"), ("leases", "finish")],
)
def test_an_outage_costs_no_attempt(world: World, monkeypatch: pytest.MonkeyPatch, part: str, method: str) -> None:
    job = world.create(checkpoint_every_steps=STEPS)
    calls = fail_for_a_while(monkeypatch, _part(world, part), method, times=2)
    done = world.run(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 1)
    assert len(calls) > 2


@pytest.mark.parametrize(("part", "method"), [("store", "put"), ("leases", "set_checkpoint")])
def test_a_checkpoint_that_cannot_be_stored_is_stored_a_little_later(
    world: World, monkeypatch: pytest.MonkeyPatch, part: str, method: str
) -> None:
    monkeypatch.setattr("worker.checkpoints._PAUSE_S", 0.0)
    monkeypatch.setattr("worker.checkpoints._PAUSE_PER_S", 0.0)
    job = world.create()
    fail_for_a_while(monkeypatch, _part(world, part), method, times=3)
    done = world.run(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 1)
    assert world.kept(job) == [40, 30, 20, 13], "three tries failed, one after each step"


def test_what_the_store_does_not_keep_as_it_was_written_is_written_again(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    job, real, broken = world.create(), world.store.put, []

    def put(key: str, data: bytes, *more: Any, **named: Any) -> Any:
        stored = real(key, data, *more, **named)
        if key.endswith("result.glb") and not broken:
            broken.append(key)
            real(key, data[:-1])
        return stored

    monkeypatch.setattr(world.store, "put", put)
    assert world.run(job).state is JobState.SUCCEEDED
    assert broken
    (artifact,) = world.record.artifacts(job.id)
    assert hashlib.sha256(world.store.get(artifact.key)).hexdigest() == artifact.sha256


def ask_to_stop(world: World, job: Job, how: str) -> None:
    """Cancel the job, or stop its worker."""
    if how == "cancel":
        world.record.request_cancel(job.id)
    else:
        world.stop = True


@pytest.mark.parametrize(("stop", "state"), STOPS)
def test_who_waits_for_a_store_that_is_away_hears_that_it_must_stop(
    world: World, monkeypatch: pytest.MonkeyPatch, stop: str, state: JobState
) -> None:
    job = world.create()
    monkeypatch.setattr(world.store, "get", lambda *_, **__: (ask_to_stop(world, job, stop), away()))
    world.runner(settings=Settings(lease_s=1.0), retry_for_s=60.0).run(job.id)
    assert world.record.get(job.id).state is state


def test_a_worker_that_stops_stores_no_checkpoint_where_it_cannot_and_hands_the_job_back(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = world.create()

    def stop(step: int) -> None:
        if step == 17:
            world.stop = True
            monkeypatch.setattr(world.store, "put", away)

    world.kind.on_step = stop
    assert world.run(job).state is JobState.QUEUED
    assert world.kept(job) == [10]


def test_a_change_in_plain_words_succeeds_without_a_step(world: World) -> None:
    stored = world.store.put("assets/chair", plain_glb(chair()), "model/gltf-binary")
    asset = StoredFile(key="assets/chair", filename="chair.glb", size=stored.size, sha256=stored.sha256)
    job = world.record.create(NewJob(JobRequest(prompt="longer legs"), {"asset": asset}))
    world.runner(start=start_run).run(job.id)
    job = world.record.get(job.id)
    assert (job.state, job.progress.step, job.progress.total_steps) == (JobState.SUCCEEDED, 0, 0)
    assert job.progress.fraction == 1.0
    names = {artifact.name for artifact in world.record.artifacts(job.id)}
    assert names == {"result.glb", "report.json", "preview.png"}
    assert world.priors == []
