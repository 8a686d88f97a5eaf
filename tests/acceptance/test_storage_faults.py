"""The fault matrix, second part: a full disk, and an object store that fails."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.acceptance.cluster import Cluster, deployed
from tests.acceptance.service import until
from tests.fault_proxy import FaultProxy
from tests.s3_server import S3Server
from tests.servers import NotInstalledError, kept_full, small_disk

pytestmark = pytest.mark.acceptance

STEPS = 12


@pytest.fixture
def proxied(
    tmp_path: Path, s3_server: S3Server, s3_store_url: str, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[Cluster, FaultProxy]]:
    """A deployment on a real S3 server, with a proxy in between that fails on demand."""
    with FaultProxy(s3_server.port) as proxy:
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{proxy.port}")
        with deployed(tmp_path, storage_url=s3_store_url) as cluster:
            yield cluster, proxy


@pytest.mark.parametrize("fault", ["error404", "refuse"])
def test_a_store_that_fails_for_a_while_delays_jobs_only(proxied: tuple[Cluster, FaultProxy], fault: str) -> None:
    cluster, proxy = proxied
    cluster.start_api()
    job_id = cluster.submit(300, every=30)
    cluster.start_worker()
    cluster.at_step(job_id, 20)
    getattr(proxy, fault)()
    assert cluster.post(STEPS).status_code == 503
    assert not cluster.record.list_jobs(cursor=None).jobs[1:], "what was refused left no job"
    # Nothing can be stored, and the attempt goes on.
    until("the worker says so", lambda: "store" in cluster.parts["worker"].log)
    cluster.when(job_id, "the end of the steps", lambda job: job.progress.step == 300)
    proxy.pass_through()
    job = cluster.check(job_id, steps=300)
    assert job.attempt == 1


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Path]:
    """A file system of two megabytes."""
    folder = tmp_path / "disk"
    folder.mkdir()
    try:
        with small_disk(folder, 2):
            yield folder
    except NotInstalledError as missing:
        pytest.skip(str(missing))


def test_a_full_disk_delays_jobs_only(tmp_path: Path, small: Path) -> None:
    with deployed(tmp_path, storage_url=str(small)) as cluster:
        cluster.start_api()
        running = cluster.submit(600, every=30)
        cluster.start_worker()
        cluster.at_step(running, 20)
        with kept_full(small / "ballast"):
            refused = cluster.post(STEPS)
            assert (refused.status_code, refused.json()["code"]) == (503, "unavailable")
            cluster.when(running, "the end of the steps", lambda job: job.progress.step == 600)
            assert not cluster.job(running).state.terminal
        assert cluster.check(running, steps=600).attempt == 1
        posted = cluster.post(STEPS)
        assert posted.status_code == 202, posted.text
        cluster.check(posted.json()["id"], steps=STEPS)
