"""The fault matrix: every part is killed at every named failpoint, and more; `docs/durability.md` has a table.

Each row ends with `Cluster.check`: one terminal event, contiguous numbers, a fraction that never goes back, one
published result, and that result the uninterrupted one.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import psutil
import pytest

from meshdeform.record.models import JobState
from meshdeform.support.failpoints import FAILPOINTS
from tests.acceptance.cluster import Cluster, deployed
from tests.acceptance.service import lives, until
from tests.servers import PostgresServer

pytestmark = pytest.mark.acceptance

WORKER_POINTS = [name for name in FAILPOINTS if name.startswith("worker.")]
API_POINTS = [name for name in FAILPOINTS if name.startswith("api.")]
STEPS = 12
SELDOM = 20
"""Checkpoints of jobs that are long, so that something can happen to them: each costs more than the steps before it."""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A deployment with an API and a worker, for tests that leave both running. They take seconds to start."""
    with deployed(tmp_path_factory.mktemp("running")) as made:
        made.start_api()
        made.start_worker()
        yield made


def waiting_at(cluster: Cluster, points: list[str]) -> dict[str, str]:
    """What makes a process wait at failpoints: it makes `POINT.reached`, and goes on when there is `POINT.go`."""
    return {"MESHDEFORM_FAILPOINTS": ",".join(f"{point}=pause:{cluster.folder / point}" for point in points)}


class Deaths:
    """Failpoints that kill, none of them yet: each acts once when it is armed, in whatever process reaches it next."""

    def __init__(self, folder: Path, points: list[str]) -> None:
        self._files = {point: folder / f"{point}.died" for point in points}
        for file in self._files.values():
            file.touch()
        kills = (f"{point}=kill;{file}" for point, file in self._files.items())
        self.environment = {"MESHDEFORM_FAILPOINTS": ",".join(kills)}

    def arm(self, point: str) -> None:
        """Let the next process die that reaches the point."""
        self._files[point].unlink()

    def wait(self, point: str) -> None:
        """Return when a process has died there."""
        until(f"a process died at {point}", self._files[point].exists)


# SIGKILL of the worker process


def test_a_worker_killed_at_every_failpoint_loses_nothing(cluster: Cluster, tmp_path: Path) -> None:
    deaths = Deaths(tmp_path, WORKER_POINTS)
    cluster.start_worker(**deaths.environment)
    # The last point first: a worker that is not new may still be on its way there from the job before.
    for point in reversed(WORKER_POINTS):
        deaths.arm(point)
        job = cluster.check(cluster.submit(STEPS), steps=STEPS)
        deaths.wait(point)
        # Before the claim there was no attempt to lose, and after the end there is nothing left to lose.
        assert job.attempt == (1 if point in ("worker.told", "worker.ended") else 2), point


# SIGKILL of the API


def test_an_api_killed_at_every_failpoint_makes_one_job_of_a_repeated_request(cluster: Cluster, tmp_path: Path) -> None:
    deaths = Deaths(tmp_path, API_POINTS)
    api = cluster.start_api(**deaths.environment)
    cluster.start_worker()
    for point in API_POINTS:
        before = {job.id for job in cluster.record.list_jobs().jobs}
        deaths.arm(point)
        with pytest.raises(httpx.TransportError):
            cluster.post(STEPS, key=point)
        api.process.wait()
        recorded = [job.id for job in cluster.record.list_jobs().jobs if job.id not in before]
        assert len(recorded) == (1 if point in ("api.recorded", "api.enqueued") else 0), point
        api = cluster.start_api(**deaths.environment)
        again = cluster.post(STEPS, key=point)
        if recorded:
            assert (again.status_code, again.json()["id"]) == (202, recorded[0]), point
        else:
            # While the dead request still holds the key, the answer is 409; its hold ends by itself.
            assert again.status_code in (202, 409), point
            assert cluster.post(STEPS, key=f"another-{point}").status_code == 202
    for job in cluster.record.list_jobs().jobs:
        cluster.check(job.id, steps=STEPS)


# SIGKILL of the supervisor, with its worker


def test_a_supervisor_killed_at_every_failpoint_of_its_worker_loses_nothing(cluster: Cluster) -> None:
    job_id = cluster.submit(STEPS)
    for point in WORKER_POINTS:
        killed = cluster.start_worker(point, **waiting_at(cluster, [point]))
        until("the worker is there", (cluster.folder / f"{point}.reached").exists)
        family = killed.children()
        killed.kill()
        # The worker is told by the kernel; it ends in order as soon as it is let go.
        (cluster.folder / f"{point}.go").touch()
        until("its worker has noticed", lambda family=family: not any(lives(process) for process in family))
        if cluster.job(job_id).state.terminal:
            cluster.check(job_id, steps=STEPS)
            job_id = cluster.submit(STEPS)
    cluster.start_worker("last")
    cluster.check(job_id, steps=STEPS)


def test_a_supervisor_killed_while_it_takes_a_job_back_loses_nothing(cluster: Cluster, tmp_path: Path) -> None:
    job_id = cluster.submit(24)
    for point in ("supervisor.reclaimed", "reconciler.reclaimed", "reconciler.told"):
        points = f"worker.step=kill@6;{tmp_path / point}-1,{point}=kill;{tmp_path / point}-2"
        cluster.start_worker(point, MESHDEFORM_FAILPOINTS=points).process.wait(timeout=240)
    cluster.start_worker("last")
    cluster.check(job_id, steps=24)


# SIGKILL of Redis, which forgets everything


def test_a_redis_killed_at_every_failpoint_of_a_worker_loses_nothing(cluster: Cluster) -> None:
    job_id = cluster.submit(STEPS)
    cluster.start_worker(**waiting_at(cluster, WORKER_POINTS))
    _kill_redis_at(cluster, WORKER_POINTS)
    cluster.check(job_id, steps=STEPS)


def test_a_redis_killed_at_every_failpoint_of_a_request_loses_nothing(cluster: Cluster) -> None:
    cluster.start_api(**waiting_at(cluster, API_POINTS))
    with ThreadPoolExecutor(1) as pool:
        posting = pool.submit(cluster.post, STEPS)
        _kill_redis_at(cluster, API_POINTS)
        answer = posting.result()
    assert answer.status_code == 202, answer.text
    cluster.start_worker()
    cluster.check(answer.json()["id"], steps=STEPS)


def _kill_redis_at(cluster: Cluster, points: list[str]) -> None:
    """Wait for the process at each point, in the order in which it comes by; kill Redis there, and let it go on."""
    for point in points:
        until(f"somebody is at {point}", (cluster.folder / f"{point}.reached").exists)
        cluster.redis.kill()
        cluster.redis.start()
        (cluster.folder / f"{point}.go").touch()


def test_a_redis_that_is_away_for_a_while_delays_jobs_only(running: Cluster) -> None:
    job_id = running.submit(400, every=SELDOM)
    running.at_step(job_id, 20)
    running.redis.kill()
    posted = running.post(STEPS)
    assert posted.status_code == 202, posted.text
    running.check(job_id, steps=400)
    # An idle worker asks the record meanwhile.
    running.check(posted.json()["id"], steps=STEPS)
    running.redis.start()
    until("the worker hears it again", lambda: "Redis is back" in running.parts["worker"].log)
    running.check(running.submit(STEPS), steps=STEPS)


# A worker that sleeps past its lease


def test_a_worker_that_wakes_up_after_its_lease_writes_nothing(cluster: Cluster) -> None:
    sleeper = cluster.start_worker("sleeper", MESHDEFORM_STEP_TIMEOUT_S="600")
    job_id = cluster.submit(300, every=SELDOM)
    cluster.at_step(job_id, 30)
    asleep = [sleeper.child(), psutil.Process(sleeper.pid)]
    for process in asleep:
        cluster.put_to_sleep(process)
    cluster.start_worker("other")
    cluster.when(job_id, "the second attempt", lambda job: job.attempt == 2)
    for process in asleep:
        process.send_signal(signal.SIGCONT)
    job = cluster.check(job_id, steps=300)
    assert job.attempt == 2
    until("the sleeper noticed", lambda: "lost its lease" in sleeper.log)
    last = cluster.events(job_id)[-1].seq
    assert [e.attempt for e in cluster.events(job_id) if e.type == "started"] == [1, 2]
    # It goes on with the next job as if nothing had been.
    cluster.parts["other"].stop()
    cluster.check(cluster.submit(STEPS), steps=STEPS)
    assert cluster.events(job_id)[-1].seq == last


# The record


def test_a_postgresql_that_crashes_and_comes_back_loses_nothing(tmp_path: Path, postgres: PostgresServer) -> None:
    with deployed(tmp_path, database_url=postgres.url) as cluster:
        cluster.start_api()
        cluster.start_worker()
        job_id = cluster.submit(400, every=SELDOM)
        cluster.at_step(job_id, 20)
        postgres.kill()
        assert cluster.post(STEPS).status_code == 503
        postgres.start()
        later = until("posting works again", lambda: cluster.post(STEPS).json().get("id"))
        cluster.check(job_id, steps=400)
        cluster.check(later, steps=STEPS)


# The end of a job has the last word


def test_a_cancel_while_parts_die_ends_in_one_state(running: Cluster) -> None:
    job_id, worker = running.submit(20_000, every=SELDOM), running.parts["worker"]
    running.at_step(job_id, 10)
    running.put_to_sleep(worker.child())
    answer = running.http.post(f"/v1/jobs/{job_id}/cancel")
    assert answer.json().get("state") == "canceling", answer.text
    worker.child().kill()
    running.check(job_id, state=JobState.CANCELED)


def test_sigterm_stores_a_checkpoint_and_counts_no_attempt_as_lost(cluster: Cluster) -> None:
    job_id = cluster.submit(400, every=SELDOM)
    worker = cluster.start_worker("first")
    reached = cluster.at_step(job_id, 25).progress.step
    assert worker.stop() == 0
    job = cluster.job(job_id)
    assert job.state is JobState.QUEUED
    assert cluster.record.leases.checkpoints(job_id)[0].step >= reached
    cluster.start_worker("second", MESHDEFORM_MAX_ATTEMPTS="1")
    cluster.check(job_id, steps=400)
