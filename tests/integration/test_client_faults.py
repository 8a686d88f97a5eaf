"""The client through whatever happens to a service: a real API process that dies, a line that breaks anywhere."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from meshdeform.client import Client, EventView
from meshdeform.client.retries import Policy
from meshdeform.errors import NotFoundError
from meshdeform.record.models import JobState
from tests.acceptance.cluster import SPHERE, Cluster, deployed
from tests.acceptance.service import until
from tests.claims import claim_job
from tests.client_flavors import both_clients, opened
from tests.fault_proxy import FaultProxy
from tests.integration.conftest import stored_result
from tests.integration.streams import recovered_run

POLICY = Policy(
    timeout_s=60.0,
    max_retries=1000,
    reconnect_s=60.0,
    silence_s=1.0,
    piece_bytes=40_000,
    first_pause_s=0.02,
    longest_pause_s=0.1,
)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """An API process on SQLite and a folder. What a worker would write, the tests write."""
    with deployed(tmp_path_factory.mktemp("cluster")) as made:
        made.start_api()
        yield made


@pytest.fixture
def proxy(cluster: Cluster) -> Iterator[FaultProxy]:
    with FaultProxy(cluster.http.base_url.port or 0) as standing:
        yield standing


@pytest.fixture
def client(proxy: FaultProxy, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Client]:
    """A client with little patience for silence and much for failures, behind the proxy."""
    monkeypatch.setattr(Policy, "of", lambda timeout_s, max_retries: POLICY)
    with opened(getattr(request, "param", "sync"), f"http://127.0.0.1:{proxy.port}", timeout_s=5.0) as made:
        yield made


def jobs_named(cluster: Cluster, label: str) -> list[str]:
    return [job.id for job in cluster.record.list_jobs(limit=200, metadata={"test": label}).jobs]


def check_whole(cluster: Cluster, job_id: str, events: list[EventView]) -> None:
    """Every event once, in order, to the one that ends the job."""
    assert [event.seq for event in events] == [event.seq for event in cluster.record.events.after(job_id)]
    assert [event.type.terminal for event in events] == [False] * (len(events) - 1) + [True]


# A request whose answer is lost


@both_clients
def test_a_lost_answer_makes_no_second_job(cluster: Cluster, proxy: FaultProxy, client: Client, request: Any) -> None:
    label = request.node.name
    proxy.cut_after(1)

    def heal() -> None:
        until("the request came through", lambda: jobs_named(cluster, label))
        proxy.pass_through()

    with ThreadPoolExecutor(1) as pool:
        healing = pool.submit(heal)
        job = client.submit(SPHERE, "a mushroom", metadata={"test": label})
        healing.result()
    assert jobs_named(cluster, label) == [job.id]
    assert proxy.connections > 1


# A stream of events


@both_clients
def test_events_go_on_over_a_line_that_breaks_within_them(cluster: Cluster, proxy: FaultProxy, client: Client) -> None:
    job_id = cluster.submit()
    recovered_run(cluster.record, job_id)
    proxy.cut_after(901)
    before = proxy.connections
    events = list(client.watch(job_id))
    check_whole(cluster, job_id, events)
    assert proxy.connections - before >= 5


@both_clients
def test_a_line_that_hangs_is_left(cluster: Cluster, proxy: FaultProxy, client: Client) -> None:
    job_id = cluster.submit()
    assert claim_job(cluster.record.leases, job_id, "worker", 60.0)
    events: list[EventView] = []
    for event in client.watch(job_id):
        events.append(event)
        if event.type == "started":
            proxy.hang()
            before = proxy.connections
            cluster.record.leases.finish(job_id, 1, JobState.SUCCEEDED)

            def heal(before: int = before) -> None:
                until("the client came again", lambda: proxy.connections > before)
                proxy.pass_through()

            healer = threading.Thread(target=heal)
            healer.start()
    healer.join()
    check_whole(cluster, job_id, events)


@both_clients
def test_a_stream_that_is_left_gives_its_connection_back(cluster: Cluster, client: Client) -> None:
    job_id = cluster.submit()
    for _ in range(3):
        for event in client.watch(job_id):
            assert event.type == "queued"
            break
    assert client.get(job_id).state is JobState.QUEUED


# Files


@both_clients
def test_an_upload_goes_on_where_it_broke_off(
    cluster: Cluster, proxy: FaultProxy, client: Client, tmp_path: Path, request: Any
) -> None:
    # A file whose end nobody looks at: an OBJ with a long comment.
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    asset = tmp_path / "tetrahedron.obj"
    asset.write_text(corners + f"# {request.node.name} {'x' * 500}\n" * 500)
    proxy.cut_after(100_000, upload=True)
    job = client.submit(asset, "a mushroom", upload=True)
    assert job.asset.sha256 == hashlib.sha256(asset.read_bytes()).hexdigest()
    assert job.asset.filename == "tetrahedron.obj"
    assert proxy.connections >= 3
    # The same once more is not sent again; a job may name it.
    key = request.node.name.encode().hex()[:100]
    first = client.upload(asset, idempotency_key=key)
    proxy.cut_after(50_000, upload=True)
    again = client.upload(asset, idempotency_key=key)
    assert (again.id, again.state) == (first.id, "complete")


def test_a_download_goes_on_where_it_broke_off(
    cluster: Cluster, proxy: FaultProxy, client: Client, tmp_path: Path
) -> None:
    content = bytes(range(256)) * 4096
    job_id = cluster.submit()
    assert claim_job(cluster.record.leases, job_id, "worker", 60.0)
    names = ("result.glb", "report.json")
    results = [stored_result(cluster.store, f"jobs/{job_id}/1/{name}", content + name.encode()) for name in names]
    cluster.record.leases.finish(job_id, 1, JobState.SUCCEEDED, results=results)
    proxy.cut_after(400_000)
    paths = client.fetch(job_id, tmp_path / "new" / "folder")
    assert {path.name: path.read_bytes() for path in paths} == {name: content + name.encode() for name in names}
    assert sorted(path.name for path in (tmp_path / "new" / "folder").iterdir()) == sorted(names)
    # What is there and the same is not sent again.
    proxy.pass_through()
    before = paths[0].stat().st_ino, paths[1].stat().st_ino
    paths[1].write_bytes(b"another")
    assert client.fetch(job_id, tmp_path / "new" / "folder") == paths
    assert paths[0].stat().st_ino == before[0]
    assert paths[1].stat().st_ino != before[1]
    assert paths[1].read_bytes().endswith(paths[1].name.encode())
    assert client.read(job_id, "result.glb") == content + b"result.glb"
    with pytest.raises(NotFoundError, match=r"result\.usd"):
        client.fetch(job_id, tmp_path, ["result.usd"])
