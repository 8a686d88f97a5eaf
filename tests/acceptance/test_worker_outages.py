"""While the object store or the record is away, a real worker keeps its attempt, and ends it when they are back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.acceptance.cluster import Cluster, running_redis, until
from tests.fault_proxy import FaultProxy
from tests.shut_database import database_to_shut

pytestmark = pytest.mark.acceptance

STEPS = 200


@contextmanager
def cluster_with(folder: Path, **urls: str) -> Iterator[Cluster]:
    """A deployment whose leases outlast the outages of this file: what is tried here is not a lost worker."""
    with running_redis(folder) as redis:
        made = Cluster(folder, redis, environment={"MESHDEFORM_LEASE_S": "60"}, **urls)
        try:
            yield made
        finally:
            made.clean_up()


@pytest.mark.parametrize("empty", [False, True], ids=["missing", "empty"])
def test_a_folder_that_is_not_mounted_costs_no_attempt(tmp_path: Path, empty: bool) -> None:
    with cluster_with(tmp_path) as cluster:
        cluster.start_api()
        worker = cluster.start_worker()
        running, queued = cluster.submit(STEPS, every=20), cluster.submit(12)
        cluster.at_step(running, 20)
        store, elsewhere = tmp_path / "objects", tmp_path / "elsewhere"
        store.rename(elsewhere)
        if empty:
            store.mkdir()
        # What starts while the store is away must not take the empty folder for a new store.
        cluster.parts["api"].kill()
        cluster.start_api()
        answers = [cluster.post(), cluster.http.get(f"/v1/jobs/{running}/asset"), cluster.http.get("/readyz")]
        assert [answer.status_code for answer in answers] == [503] * 3
        assert answers[-1].json()["store"]["status"] == "unavailable"
        until("a checkpoint is missed", lambda: "is not stored: " in worker.log)
        until("an upload failed", lambda: "result.glb: " in worker.log)
        assert not empty or list(store.iterdir()) == []
        if empty:
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
        with cluster_with(tmp_path, database_url=url) as cluster:
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
    with database_to_shut(postgres_url) as database, running_redis(tmp_path) as redis:
        cluster = Cluster(tmp_path, redis, database_url=database.url)
        try:
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
        finally:
            cluster.clean_up()
