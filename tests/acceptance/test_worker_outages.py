"""While the object store or the record is away, a real worker keeps its attempt, and ends it when they are back."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.acceptance.cluster import deployed
from tests.acceptance.service import until
from tests.fault_proxy import FaultProxy
from tests.shut_database import database_to_shut

pytestmark = pytest.mark.acceptance

STEPS = 200


LONG = {"MESHDEFORM_LEASE_S": "60"}
"""Leases that outlast the outages of this file, where what is tried is not a lost worker."""


def test_a_folder_that_is_not_mounted_costs_no_attempt(tmp_path: Path) -> None:
    """Nor is the empty folder in its place taken for a new store."""
    with deployed(tmp_path, environment=LONG) as cluster:
        cluster.start_api()
        worker = cluster.start_worker()
        running, queued = cluster.submit(STEPS, every=20), cluster.submit(12)
        cluster.at_step(running, 20)
        store, elsewhere = tmp_path / "objects", tmp_path / "elsewhere"
        store.rename(elsewhere)
        store.mkdir()
        cluster.parts["api"].kill()
        cluster.start_api()
        answers = [cluster.post(), cluster.http.get(f"/v1/jobs/{running}/asset"), cluster.http.get("/readyz")]
        assert [answer.status_code for answer in answers] == [503] * 3
        assert answers[-1].json()["store"]["status"] == "unavailable"
        until("a checkpoint is missed", lambda: "is not stored: " in worker.log)
        until("an upload failed", lambda: "result.glb: " in worker.log)
        assert list(store.iterdir()) == []
        store.rmdir()
        elsewhere.rename(store)
        for job_id, steps in ((running, STEPS), (queued, 12)):
            assert cluster.check(job_id, steps=steps).attempt == 1
        assert cluster.http.get(f"/v1/jobs/{running}/asset").status_code == 200


def test_a_supervisor_waits_for_a_record_that_is_not_up_yet(
    tmp_path: Path, postgres_port: int, postgres_url: str
) -> None:
    with FaultProxy(postgres_port) as proxy:
        url = postgres_url.replace(f":{postgres_port}/", f":{proxy.port}/").replace("+pg8000", "")
        with deployed(tmp_path, environment=LONG, database_url=url) as cluster:
            job_id = cluster.submit(STEPS, every=20)
            proxy.refuse()
            worker = cluster.start_worker()
            until("it waits", lambda: "waiting for the record" in worker.log)
            proxy.pass_through()
            assert cluster.check(job_id, steps=STEPS).attempt == 1


@pytest.mark.parametrize("way", ["read-only", "no login"])
def test_a_record_that_takes_no_writes_or_no_logins_ends_no_supervisor(
    way: str, tmp_path: Path, postgres_url: str
) -> None:
    with database_to_shut(postgres_url) as database, deployed(tmp_path, database_url=database.url) as cluster:
        supervisor = cluster.start_worker()
        job_id = cluster.submit(STEPS, every=20)
        cluster.at_step(job_id, 20)
        database.shut(way)
        # The first that a supervisor writes when its worker dies.
        supervisor.child().kill()
        until("the lease is not given up", lambda: "stays claimed until its lease expires" in supervisor.log)
        until("the reconciler waits", lambda: "the reconciler will retry" in supervisor.log)
        assert supervisor.process.poll() is None
        database.open(way)
        cluster.check(job_id, steps=STEPS)
        assert supervisor.process.poll() is None
        assert "Traceback" not in supervisor.log


def test_a_worker_that_is_cut_off_loses_its_job_to_another_one(
    tmp_path: Path, postgres_port: int, postgres_url: str
) -> None:
    """Its connections hang, as those of a host whose cable is pulled, and it goes on with its steps meanwhile."""
    direct = postgres_url.replace("+pg8000", "")
    with FaultProxy(postgres_port) as proxy, deployed(tmp_path, database_url=direct) as cluster:
        through = direct.replace(f":{postgres_port}/", f":{proxy.port}/")
        cut_off = cluster.start_worker("cut off", MESHDEFORM_DATABASE_URL=through, FAKE_STEP_S="0.05")
        job_id = cluster.submit(STEPS, every=20)
        cluster.at_step(job_id, 20)
        proxy.hang()
        other = cluster.start_worker("other")
        assert cluster.check(job_id, steps=STEPS).attempt == 2
        last = cluster.events(job_id)[-1].seq
        proxy.pass_through()
        other.stop()
        cluster.check(cluster.submit(12), steps=12)
        until("it noticed", lambda: "lost its lease" in cut_off.log)
        assert cluster.events(job_id)[-1].seq == last
