"""A worker apart from `serve`, as `meshdeform worker` runs it: real supervisor, real RQ, real signals."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from meshdeform.record.models import JobState, NewJob, StoredFile
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from meshdeform.requests.removed import grouped
from meshdeform.storage import ObjectStore
from tests.acceptance.cluster import Followed, until
from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Gate

pytestmark = pytest.mark.acceptance

STEPS, EVERY = 40, 5


class Deployment(Followed):
    """Record, store and queue that a test shares with the workers it starts."""

    def __init__(self, folder: Path, redis_url: str) -> None:
        self.environment = {
            "MESHDEFORM_DATA_DIR": str(folder),
            "MESHDEFORM_REDIS_URL": redis_url,
            "MESHDEFORM_THREADS": "1",
            "MESHDEFORM_LEASE_S": "5",
        }
        self.record = JobRecord(f"sqlite:///{folder / 'meshdeform.sqlite'}")
        self.store = ObjectStore(str(folder / "objects"))
        self.queue = JobQueue(redis_url, "meshdeform")
        heights = {"asset": 1.0, "target": 1.6}
        self._files = {part: self._upload(write_ellipsoid(folder / f"{h}.obj", h)) for part, h in heights.items()}
        self.lines: list[str] = []

    def _upload(self, path: Path) -> StoredFile:
        stored = self.store.put(f"assets/{path.name}", path.read_bytes(), "model/obj")
        return StoredFile(key=f"assets/{path.name}", filename=path.name, size=stored.size, sha256=stored.sha256)

    def submit(self, **params: Any) -> str:
        """Record a job and tell the queue."""
        params = grouped({"guidance": "target", "steps": STEPS, "checkpoint_every_steps": EVERY, **params})
        job = self.record.create(NewJob(JobRequest.model_validate({"params": grouped(params)}), self._files))
        self.queue.enqueue(job.id)
        return job.id

    @contextlib.contextmanager
    def worker(self) -> Iterator[subprocess.Popen[str]]:
        """`meshdeform worker`, ended with the block; its worker process too."""
        with subprocess.Popen(
            [sys.executable, "-P", "-m", "meshdeform", "worker"],
            env={**os.environ, **self.environment},
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stderr is not None
            reader = threading.Thread(target=lambda lines: self.lines.extend(lines), args=(process.stderr,))
            reader.start()
            try:
                yield process
            finally:
                family = [] if process.poll() is not None else psutil.Process(process.pid).children(recursive=True)
                process.kill()
                for child in family:
                    with contextlib.suppress(psutil.NoSuchProcess):
                        child.kill()
                reader.join()

    @property
    def logs(self) -> str:
        """What the workers printed."""
        return "".join(self.lines)

    def result(self, job_id: str) -> bytes:
        """The bytes of result.glb."""
        (key,) = [a.key for a in self.record.artifacts(job_id) if a.name == "result.glb"]
        return self.store.get(key)


@pytest.fixture
def deployment(tmp_path: Path, redis_url: str) -> Iterator[Deployment]:
    deployment = Deployment(tmp_path, redis_url)
    yield deployment
    deployment.queue.close()
    deployment.record.close()


def worker_process(supervisor: subprocess.Popen[str]) -> psutil.Process:
    return until("a worker process", lambda: next(iter(psutil.Process(supervisor.pid).children()), None))


def gone(process: psutil.Process) -> bool:
    with contextlib.suppress(psutil.NoSuchProcess):
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    return True


@pytest.mark.long  # test_faults.py does the same with a sum, and test_serve.py with Ctrl-C and SIGKILL
def test_sigterm_hands_the_job_back_and_the_next_worker_ends_it_with_the_same_bytes(
    deployment: Deployment, tmp_path: Path
) -> None:
    gate = Gate(tmp_path / "gate")
    whole, job = deployment.submit(), deployment.submit()
    deployment.environment["MESHDEFORM_FAILPOINTS"] = f"worker.step=pause@{STEPS + EVERY + 2}:{gate.path}"
    with deployment.worker() as first:
        assert deployment.finished(whole).state is JobState.SUCCEEDED
        gate.wait()
        first.terminate()
        gate.open()
        assert first.wait(timeout=60) == 0, deployment.logs
    handed_back = deployment.record.get(job)
    assert (handed_back.state, handed_back.attempt) == (JobState.QUEUED, 1)
    newest = deployment.record.leases.checkpoints(job)[0]
    assert newest.step >= handed_back.progress.step  # where it stopped, not where the last interval ended
    with deployment.worker():
        done = deployment.finished(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 2)
    assert deployment.result(job) == deployment.result(whole)


@pytest.mark.long  # test_faults.py does the same with a sum for the deformation
def test_a_killed_worker_process_is_replaced_without_a_wait_for_its_lease(deployment: Deployment) -> None:
    deployment.environment["MESHDEFORM_LEASE_S"] = "3600"
    job = deployment.submit(steps=120)
    with deployment.worker() as supervisor:
        deployment.at_step(job, EVERY + 1)
        worker_process(supervisor).kill()
        done = deployment.finished(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 2)


@pytest.mark.long  # test_faults.py does the same with a sum for the deformation
def test_a_killed_supervisor_takes_its_worker_along_and_another_resumes(deployment: Deployment) -> None:
    job = deployment.submit(steps=120)
    with deployment.worker() as first:
        deployment.at_step(job, EVERY + 1)
        process = worker_process(first)
        first.kill()
        until("the worker process ends", lambda: gone(process))
    with deployment.worker():
        assert deployment.finished(job).state is JobState.SUCCEEDED


@pytest.mark.long  # test_faults.py does the same with a sum for the deformation
def test_a_worker_that_is_frozen_past_its_lease_loses_the_job_and_writes_nothing_more(deployment: Deployment) -> None:
    job = deployment.submit(steps=300)
    with deployment.worker() as first:
        deployment.at_step(job, EVERY + 1)
        frozen = worker_process(first)
        frozen.send_signal(signal.SIGSTOP)
        # The supervisor's reconciler takes the job back; another worker runs it.
        deployment.when(job, "the job is taken back", lambda job: job.state is JobState.QUEUED)
        with deployment.worker():
            deployment.when(job, "attempt 2 runs", lambda job: job.attempt == 2)
            frozen.send_signal(signal.SIGCONT)
            done = deployment.finished(job)
            assert (done.state, done.attempt) == (JobState.SUCCEEDED, 2)
            assert {a.key.split("/")[2] for a in deployment.record.artifacts(job)} == {"2"}
            # The first worker noticed, and is free for the next job.
            assert deployment.finished(deployment.submit(steps=2)).state is JobState.SUCCEEDED
        assert frozen.is_running()


@pytest.mark.long  # test_faults.py does the same with a sum for the deformation
def test_a_job_that_kills_every_worker_fails_at_last(deployment: Deployment) -> None:
    job = deployment.submit(steps=50_000)
    with deployment.worker() as supervisor:
        for attempt in (1, 2, 3):
            deployment.when(
                job, f"attempt {attempt}", lambda job, n=attempt: job.attempt == n and job.progress.step > 0
            )
            worker_process(supervisor).kill()
        done = deployment.finished(job)
    assert done.error is not None
    assert (done.state, done.error.code) == (JobState.FAILED, "worker_lost")


@pytest.mark.long  # test_faults.py does the same with a sum for the deformation
def test_a_redis_that_loses_everything_loses_no_job(deployment: Deployment, redis_url: str) -> None:
    import redis

    running, waiting = deployment.submit(steps=300), deployment.submit(steps=2)
    with deployment.worker():
        deployment.at_step(running, 1)
        with redis.Redis.from_url(redis_url) as connection:
            connection.flushall()
        assert deployment.finished(running).state is JobState.SUCCEEDED
        assert deployment.finished(waiting).state is JobState.SUCCEEDED
