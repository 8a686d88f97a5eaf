"""One attempt ends in exactly one way, on a real record and a real store, with a fake kind that takes no time."""

from __future__ import annotations

import contextlib
import hashlib
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from meshdeform.config import JobRequest
from meshdeform.errors import NumericalError, UnavailableError
from meshdeform.jobs.models import Job, JobState, StoredFile
from meshdeform.jobs.record import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from tests.fake_kind import FakeKind
from worker.runner import JobRunner

STEPS, EVERY = 50, 10


class World:
    """A worker's surroundings."""

    def __init__(self, folder: Path) -> None:
        self.record = JobRecord(f"sqlite:///{folder / 'record.sqlite'}")
        self.store = ObjectStore(str(folder / "objects"))
        self.kind = FakeKind()
        self.priors: list[str] = []
        self.stop = False

    def runner(self) -> JobRunner:
        return JobRunner(
            settings=Settings(),
            record=self.record,
            store=self.store,
            listen=self._listen,
            start=self.kind.start,
            load_prior=self._load_prior,
            device="cpu",
            stopping=lambda: self.stop,
            worker_id="a worker",
        )

    def create(self, **params: Any) -> Job:
        data = b"an asset"
        stored = self.store.put("assets/a", data, "model/gltf-binary")
        asset = StoredFile(key="assets/a", filename="a.glb", size=stored.size, sha256=stored.sha256)
        params = {"steps": STEPS, "checkpoint_every_steps": EVERY, "guidance": "target", **params}
        return self.record.create(JobRequest.model_validate({"prompt": "a vase", "params": params}), asset, asset)

    def expire(self, job: Job) -> None:
        """Let the lease of whoever has the job be over."""
        self.record.heartbeat(job.id, self.record.get(job.id).attempt, -1.0)

    def run(self, job: Job) -> Job:
        self.runner().run(job.id)
        return self.record.get(job.id)

    def result(self, job: Job) -> bytes:
        (artifact,) = self.record.artifacts(job.id)
        return self.store.get(artifact.key)

    def kept(self, job: Job) -> list[int]:
        return [reference.step for reference in self.record.checkpoints(job.id)]

    def _load_prior(self, model: str) -> Any:
        self.priors.append(model)
        return object()

    @contextlib.contextmanager
    def _listen(self, job_id: str) -> Iterator[Any]:
        import time

        class Deaf:
            def wait(self, timeout_s: float) -> bool:
                time.sleep(min(timeout_s, 0.005))
                return False

        yield Deaf()


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    world = World(tmp_path)
    yield world
    world.record.close()


def test_a_job_succeeds_with_its_results_and_the_last_two_checkpoints(world: World) -> None:
    job = world.run(world.create())
    assert (job.state, job.attempt, job.error) == (JobState.SUCCEEDED, 1, None)
    (artifact,) = world.record.artifacts(job.id)
    data = world.store.get(artifact.key)
    assert (artifact.size, artifact.sha256) == (len(data), hashlib.sha256(data).hexdigest())
    assert artifact.key == f"jobs/{job.id}/1/result.glb"
    assert (job.progress.step, job.progress.fraction) == (STEPS, 1.0)
    assert world.kept(job) == [40, 30]
    (given,) = world.kind.started
    assert (given["asset"], given["filename"], given["target"], given["prior"]) == (
        b"an asset",
        "a.glb",
        b"an asset",
        None,
    )


def test_only_score_distillation_loads_a_prior(world: World) -> None:
    world.run(world.create(guidance="sds"))
    assert world.priors == ["builtin"]
    assert world.kind.started[0]["prior"] is not None


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
    settings = Settings(lease_s=1.0)
    runner = world.runner()
    JobRunner(**{**vars(runner), "settings": settings}).run(job.id)
    job = world.record.get(job.id)
    assert job.state is JobState.CANCELED
    assert world.record.artifacts(job.id) == []


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
    assert world.record.reclaim_expired(3) == [job.id]


def test_a_lost_attempt_is_resumed_from_the_last_checkpoint(world: World) -> None:
    whole = world.create()
    world.run(whole)
    job = world.create()
    lose(world, job, at=35)
    done = world.run(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 2)
    assert world.kind.started_at == [0, 0, 30]
    assert world.result(job) == world.result(whole)


@pytest.mark.parametrize(("damaged", "resumed_at"), [([0], 20), ([0, 1], 0)])
@pytest.mark.parametrize("damage", ["torn", "gone"])
def test_a_torn_checkpoint_falls_back_to_the_one_before(
    world: World, damaged: list[int], resumed_at: int, damage: str
) -> None:
    job = world.create()
    lose(world, job, at=35)
    references = world.record.checkpoints(job.id)
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
    claimed = world.record.claim(job.id, "another", 30.0)
    assert claimed is not None
    data = b"whole, but of another format"
    world.store.put("jobs/x", data, "application/octet-stream")
    world.record.set_checkpoint(job.id, claimed.attempt, key="jobs/x", step=40, sha256=hashlib.sha256(data).hexdigest())
    world.record.release(job.id, claimed.attempt)
    assert world.run(job).state is JobState.SUCCEEDED
    assert world.kind.started_at[-1] == 30


def test_an_attempt_that_lost_its_lease_writes_nothing_more(world: World) -> None:
    job = world.create(steps=50_000)

    def usurp(step: int) -> None:
        if step == 15:
            world.expire(job)
            assert world.record.claim(job.id, "another", 30.0) is not None

    world.kind.on_step = usurp
    JobRunner(**{**vars(world.runner()), "settings": Settings(lease_s=1.0)}).run(job.id)
    left = world.record.get(job.id)
    assert (left.state, left.attempt, left.error) == (JobState.RUNNING, 2, None)
    assert world.record.artifacts(job.id) == []


def test_a_store_that_is_away_leaves_the_job_to_the_next_attempt(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    job = world.create()
    with monkeypatch.context() as patch:
        patch.setattr(world.store, "put", _away)
        with pytest.raises(UnavailableError):
            world.run(job)
    assert world.record.get(job.id).state is JobState.RUNNING
    world.expire(job)
    assert world.record.reclaim_expired(3) == [job.id]
    assert world.run(job).state is JobState.SUCCEEDED


def _away(*_: Any, **__: Any) -> Any:
    raise UnavailableError("the store does not answer")
