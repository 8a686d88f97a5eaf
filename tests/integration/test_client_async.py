"""What only an event loop does: many jobs at a time, tasks that are canceled; and Ctrl-C, which only a thread gets."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import Awaitable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import anyio
import pytest

from meshdeform.client import AsyncClient, Client, EventView, WaitTimeoutError
from meshdeform.errors import NumericalError
from meshdeform.record.models import JobState
from tests.acceptance.cluster import SPHERE, Cluster, deployed, sum_after
from tests.client_flavors import FLAVORS, opened

STEPS = {"steps": 12}


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """An API process and a worker process that adds numbers; a prompt with `hangs` keeps it for an hour."""
    with deployed(tmp_path_factory.mktemp("cluster"), environment={"FAKE_STEP_S": "0"}) as made:
        made.start_api()
        made.start_worker()
        yield made


@pytest.fixture
def url(cluster: Cluster) -> str:
    return str(cluster.http.base_url)


@pytest.mark.parametrize("flavor", FLAVORS)
def test_from_a_file_to_a_result(cluster: Cluster, url: str, flavor: str, tmp_path: Path) -> None:
    events: list[EventView] = []
    with opened(flavor, url) as client:
        result = client.deform(SPHERE.read_bytes(), "a mushroom", params=STEPS, on_event=events.append)
        assert result.job.state is JobState.SUCCEEDED
        assert result.glb() == sum_after(12)
        assert [path.read_bytes() for path in result.save(tmp_path / "out")] == [sum_after(12)]
        assert [artifact.name for artifact in result.artifacts()] == ["result.glb"]
        assert [event.seq for event in events] == [event.seq for event in cluster.record.events.after(result.id)]
        with pytest.raises(NumericalError, match="not finite") as caught:
            client.result(cluster.submit(12, prompt="it fails"))
        assert caught.value.advice


def test_threads_share_a_client(cluster: Cluster, url: str) -> None:
    ids = [cluster.submit(3) for _ in range(6)]
    with Client(url) as client, ThreadPoolExecutor(6) as pool:
        results = list(pool.map(client.result, ids))
        followed = list(pool.map(lambda job_id: [event.seq for event in client.watch(job_id)], ids))
    assert [result.id for result in results] == ids
    assert followed == [[event.seq for event in cluster.record.events.after(job_id)] for job_id in ids]


LONG = {"steps": 50_000}


@pytest.mark.parametrize("how", ["task", "scope"])
def test_a_canceled_task_cancels_its_job(cluster: Cluster, url: str, how: str) -> None:
    found: list[str] = []

    async def main() -> None:
        begun = asyncio.Event()

        async def on_event(event: EventView) -> None:
            found.append(event.job_id)
            begun.set()
            await asyncio.sleep(0)

        async with AsyncClient(url) as client:
            deforming = client.deform(SPHERE, "a mushroom", params=LONG, on_event=on_event)
            if how == "task":
                task = asyncio.create_task(deforming)
                await begun.wait()
                task.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await task
                return
            async with anyio.create_task_group() as group:
                group.start_soon(_awaited, deforming)
                await begun.wait()
                group.cancel_scope.cancel()

    asyncio.run(main())
    assert cluster.finished(found[0]).state is JobState.CANCELED


async def _awaited(what: Awaitable[object]) -> None:
    await what


def test_a_job_may_outlive_its_task(cluster: Cluster, url: str) -> None:
    found: list[str] = []

    async def main() -> None:
        async with AsyncClient(url) as client:
            with anyio.CancelScope() as scope:

                def on_event(event: EventView) -> None:
                    found.append(event.job_id)
                    scope.cancel()

                await client.deform(SPHERE, "a mushroom", params=STEPS, on_event=on_event, cancel_on_interrupt=False)
            assert scope.cancelled_caught

    asyncio.run(main())
    assert cluster.finished(found[0]).state is JobState.SUCCEEDED


_SCRIPT = """
import sys
from meshdeform import Client
with Client(sys.argv[1]) as client:
    client.deform(
        sys.argv[2], "a mushroom", params={"steps": 50_000}, on_event=lambda event: print(event.job_id, flush=True)
    )
"""


def test_ctrl_c_cancels_the_job(cluster: Cluster, url: str) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", _SCRIPT, url, str(SPHERE)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert child.stdout is not None
        job_id = child.stdout.readline().strip()
        assert job_id
        child.send_signal(signal.SIGINT)
        _, errors = child.communicate(timeout=240)
    finally:
        child.kill()
        child.communicate()
    assert child.returncode != 0
    assert errors.rstrip().endswith("KeyboardInterrupt")
    assert cluster.finished(job_id).state is JobState.CANCELED


def test_waiting_ends_when_its_time_is_up(cluster: Cluster, url: str) -> None:
    job_id = cluster.submit(50_000)
    with Client(url) as client:
        for listeners in ({}, {"on_event": lambda event: None}, {"on_change": lambda job: None}):
            with pytest.raises(WaitTimeoutError, match=job_id) as caught:
                client.wait(job_id, timeout_s=0.3, **listeners)
            assert caught.value.extra == {"job_id": job_id}
        assert not client.get(job_id).state.terminal
        client.cancel(job_id)
        assert client.wait(job_id, check=False).state is JobState.CANCELED
        again = client.retry(job_id)
        assert again.origin is not None
        assert again.origin.job_id == job_id
        client.cancel(again)
        client.wait(again, check=False)
        client.delete(again)
        assert again.id not in [job.id for job in client.jobs(limit=2)]


def test_a_job_is_branched_at_a_checkpoint(cluster: Cluster, url: str, tmp_path: Path) -> None:
    with opened("async", url) as client:
        job = client.deform(SPHERE, "a mushroom", params={"steps": 8, "checkpoint_every_steps": 4}).job
        assert [checkpoint.step for checkpoint in client.checkpoints(job)] == [4]
        assert client.download_checkpoint(job, 4, tmp_path / "half.glb").read_bytes() == sum_after(4)
        assert client.download_asset(job, tmp_path / "asset.glb").read_bytes() == SPHERE.read_bytes()
        other, same = (client.branch(job, 4, "a vase", params=STEPS, idempotency_key="branch") for _ in range(2))
        assert other == same
        assert other.prompt == "a vase"
        assert other.origin is not None
        assert (other.origin.job_id, other.origin.step) == (job.id, 4)
        assert client.wait(other).state is JobState.SUCCEEDED
        # What it made is the next one's asset.
        found = client.validate(SPHERE, "a mushroom", params=STEPS)
        assert found.asset.sha256 == job.asset.sha256
        assert found.params.steps == 12
        assert {model.id for model in client.models().models} >= {"builtin"}
        assert client.limits().jobs.max_steps == 50_000
