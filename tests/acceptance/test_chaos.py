"""Many short jobs under random faults: none is lost, none ends twice, each gives what it would have given."""

from __future__ import annotations

import contextlib
import random
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from meshdeform.errors import ConflictError, UnavailableError
from meshdeform.record.models import JobState
from tests.acceptance.chaos import Chaos
from tests.acceptance.cluster import Cluster, running_redis
from tests.acceptance.service import until
from tests.servers import NotInstalledError, PostgresServer

pytestmark = pytest.mark.acceptance

SEED = 20260131
SUPERVISORS = ["one", "two"]


@pytest.fixture
def postgres(server_folder: Path) -> Iterator[PostgresServer]:
    folder = server_folder / f"chaos-{time.time_ns()}"
    folder.mkdir()
    try:
        server = PostgresServer(folder, durable=True)
    except NotInstalledError as missing:
        pytest.skip(str(missing))
    server.start()
    yield server
    server.kill()


def test_jobs_survive_random_faults(tmp_path: Path, postgres: PostgresServer) -> None:
    """`python -m bench.outages --chaos 200` has more of them, for longer."""
    environment = {"MESHDEFORM_LEASE_S": "2", "MESHDEFORM_MAX_ATTEMPTS": "100", "MESHDEFORM_STEP_TIMEOUT_S": "30"}
    with running_redis(tmp_path) as redis:
        cluster = Cluster(tmp_path, redis, database_url=postgres.url, environment=environment)
        try:
            cluster.start_api()
            for name in SUPERVISORS:
                cluster.start_worker(name)
            with Chaos(cluster, SEED, SUPERVISORS, postgres=postgres, pause_s=(0.4, 2.0)) as chaos:
                steps, canceled = _submit(cluster, 6)
                _all_ended(cluster, steps)
            ends = _check(cluster, steps, canceled)
            print(f"seed {SEED}: {sum(chaos.faults.values())} faults {dict(chaos.faults)}; jobs {dict(ends)}")
            assert chaos.faults
        finally:
            cluster.clean_up()


def _submit(cluster: Cluster, count: int) -> tuple[dict[str, int], set[str]]:
    """Record the jobs, most of them directly and some over HTTP, and ask for the cancel of a few."""
    choose = random.Random(SEED)
    steps: dict[str, int] = {}
    canceled: set[str] = set()
    for number in range(count):
        length = choose.choice([4, 8, 12, 20, 40])
        if number % 10 == 0:
            key = f"chaos-{number}"

            def posted(length: int = length, key: str = key) -> str | None:
                answer = cluster.post(length, key=key)
                return str(answer.json()["id"]) if answer.status_code in (200, 202) else None

            job_id = until("a job is posted", posted, deadline_s=200.0)
        else:

            def recorded(length: int = length, label: str = str(number)) -> str:
                # A commit whose answer got lost has made the job all the same.
                made = cluster.record.list_jobs(metadata={"number": label}).jobs
                return made[0].id if made else cluster.submit(length, metadata={"number": label})

            job_id = until("a job is recorded", recorded, deadline_s=200.0)
        assert job_id not in steps
        steps[job_id] = length
        if choose.random() < 0.05:
            with contextlib.suppress(ConflictError, UnavailableError):
                cluster.record.request_cancel(job_id)
                canceled.add(job_id)
    return steps, canceled


def _all_ended(cluster: Cluster, steps: dict[str, int]) -> None:
    deadline = time.monotonic() + 500.0
    for job_id in steps:

        def ended(job_id: str = job_id) -> bool:
            return cluster.record.get(job_id).state.terminal

        until("every job is over", ended, deadline_s=deadline - time.monotonic())


def _check(cluster: Cluster, steps: dict[str, int], canceled: set[str]) -> Counter[str]:
    ends: Counter[str] = Counter()
    page, found = None, set()
    while True:
        listed = cluster.record.list_jobs(cursor=page, limit=100)
        found |= {job.id for job in listed.jobs}
        if (page := listed.next_cursor) is None:
            break
    assert found == set(steps), "the record has exactly the jobs that were accepted"
    for job_id, length in steps.items():
        job = cluster.job(job_id)
        assert job.state is JobState.SUCCEEDED or (job_id in canceled and job.state is JobState.CANCELED), job
        cluster.check(job_id, steps=length, state=job.state)
        ends[job.state] += 1
    return ends
