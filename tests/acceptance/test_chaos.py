"""Short jobs under random faults: none is lost, none ends twice, each gives what it would have given."""

from __future__ import annotations

import contextlib
import random
from functools import partial
from pathlib import Path

import pytest

from meshdeform.errors import ConflictError, UnavailableError
from meshdeform.record.models import JobState
from tests.acceptance.chaos import Chaos
from tests.acceptance.cluster import Cluster, deployed
from tests.acceptance.service import until
from tests.servers import PostgresServer

pytestmark = pytest.mark.acceptance

SEED = 20260131
SUPERVISORS = ["one", "two"]
SETTINGS = {"MESHDEFORM_LEASE_S": "2", "MESHDEFORM_MAX_ATTEMPTS": "100", "MESHDEFORM_STEP_TIMEOUT_S": "30"}


def accepted(cluster: Cluster, number: int, steps: int) -> str | None:
    """Record a job, every second one over HTTP, and return its id if that was accepted."""
    if number % 2:
        answer = cluster.post(steps, key=f"chaos-{number}")
        return str(answer.json()["id"]) if answer.status_code in (200, 202) else None
    # A commit whose answer got lost has made the job all the same.
    label = {"number": str(number)}
    made = cluster.record.list_jobs(metadata=label).jobs
    return made[0].id if made else cluster.submit(steps, metadata=label)


def test_jobs_survive_random_faults(tmp_path: Path, postgres: PostgresServer) -> None:
    """`python -m bench.outages --chaos 200` has more of them, for longer."""
    choose, steps = random.Random(SEED), dict[str, int]()
    with deployed(tmp_path, database_url=postgres.url, environment=SETTINGS) as cluster:
        cluster.start_api()
        for name in SUPERVISORS:
            cluster.start_worker(name)
        with Chaos(cluster, SEED, SUPERVISORS, postgres=postgres, pause_s=(0.4, 2.0)) as chaos:
            for number in range(6):
                length = choose.choice([4, 8, 12, 20, 40])
                asked = until("a job is accepted", partial(accepted, cluster, number, length), deadline_s=200.0)
                assert asked not in steps
                steps[asked] = length
            with contextlib.suppress(ConflictError, UnavailableError):
                cluster.record.request_cancel(asked)
            for job_id in steps:
                cluster.finished(job_id)
        assert {job.id for job in cluster.record.list_jobs(limit=100).jobs} == set(steps)
        for job_id, length in steps.items():
            state = cluster.job(job_id).state
            assert state is JobState.SUCCEEDED or (job_id, state) == (asked, JobState.CANCELED)
            cluster.check(job_id, steps=length, state=state)
        assert chaos.faults
