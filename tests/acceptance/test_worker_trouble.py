"""A real supervisor and a real worker process in trouble: no memory on the device, a step that hangs, an outage."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from meshdeform.record.models import JobState
from tests.acceptance.cluster import Cluster, running_redis
from tests.acceptance.service import until
from tests.cases import each_case
from tests.fake_worker import TROUBLE_AT

pytestmark = pytest.mark.acceptance

STEPS = 12


@contextlib.contextmanager
def deployed(folder: Path, **environment: str) -> Iterator[Cluster]:
    """A deployment on SQLite and a folder, with a worker and no API."""
    with running_redis(folder) as redis:
        made = Cluster(folder, redis)
        try:
            made.start_worker(**environment)
            yield made
        finally:
            made.clean_up()


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """One whose worker is out of memory once, and whose jobs have two attempts."""
    folder = tmp_path_factory.mktemp("usual")
    with deployed(
        folder, FAKE_OOM_ONCE=str(folder / "once"), FAKE_FROZEN=str(folder / "frozen"), MESHDEFORM_MAX_ATTEMPTS="2"
    ) as made:
        yield made


def test_a_device_without_memory_gets_a_clean_context_and_the_job_goes_on(usual: Cluster) -> None:
    # Two attempts may be lost: this one is none.
    worker = usual.parts["worker"]
    first = worker.child().pid
    job = usual.check(usual.submit(STEPS, prompt="ooms once"), steps=STEPS)
    assert (job.attempt, job.oom_attempts) == (2, 1)
    events = usual.events(job.id)
    assert TROUBLE_AT - 1 in [e.data["step"] for e in events if e.type == "checkpoint" and e.attempt == 1]
    assert [e.data["reason"] for e in events if e.type == "queued"][1:] == ["out_of_memory"]
    assert "ended with exit code 75; starting it again in 0 s" in worker.log
    assert worker.child().pid != first


def test_a_step_that_hangs_is_killed_and_fails_the_job_at_last(tmp_path: Path) -> None:
    with deployed(tmp_path, MESHDEFORM_STEP_TIMEOUT_S="4", MESHDEFORM_MAX_ATTEMPTS="2") as impatient:
        job = impatient.check(impatient.submit(STEPS, prompt="hangs"), state=JobState.FAILED)
        assert job.error is not None
        assert (job.error.code, job.attempt) == ("worker_lost", 2)
        impatient.check(impatient.submit(STEPS), steps=STEPS)


@each_case("trouble", ["hangs", "freezes"])
def test_a_cancellation_does_not_wait_for_a_step_that_does_not_end(usual: Cluster, trouble: str) -> None:
    """The record has one end of the job, in one attempt, and the next job has a worker."""
    worker = usual.parts["worker"]
    job_id = usual.submit(STEPS, prompt=trouble)
    if trouble == "hangs":
        usual.at_step(job_id, TROUBLE_AT - 1)
    else:
        until("it is frozen", (usual.folder / "frozen").exists)
    process = worker.child()
    usual.record.request_cancel(job_id)
    job = usual.check(job_id, state=JobState.CANCELED)
    assert job.attempt == 1
    assert [e.type for e in usual.events(job_id)].count("canceled") == 1
    until("the process is replaced", lambda: not process.is_running() and worker.child())
    usual.check(usual.submit(STEPS), steps=STEPS)
    assert usual.job(job_id) == job


def test_a_worker_starts_works_and_stops_while_redis_is_away(tmp_path: Path) -> None:
    with running_redis(tmp_path) as redis:
        redis.kill()
        made = Cluster(tmp_path, redis)
        try:
            worker = made.start_worker()
            made.check(made.submit(STEPS), steps=STEPS)
            assert worker.stop() == 0
        finally:
            made.clean_up()
