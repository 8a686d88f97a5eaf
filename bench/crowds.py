"""One API on PostgreSQL with a long queue and many workers, or with many streams: ``python -m bench.crowds``.

    python -m bench.crowds queue      50 workers; the same requests with 1,000 and with 100,000 queued jobs
    python -m bench.crowds streams    20 clients that post without a pause, beside 100 streams of events and without

`queue`: the workers are real ones whose jobs are sums of twenty steps of half a second. Prints, for each request and
for the claim of a worker, the median of one client with the long queue relative to that with the short one, in one run,
and the jobs that the workers ended per second. `streams`: each is told of progress every five seconds; prints p50 and
p99 of posts without and with them, in turns, and the p99 beside streams relative to the p50 without. Everything shares
the machine, so ratios are what counts.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import hashlib
import itertools
import os
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import sqlalchemy as sa

from bench.load import REQUEST, Clients
from bench.record_load import claim_and_release, fill_between, settle
from meshdeform.record.models import JobState, NewJob, Progress, StoredFile
from meshdeform.record.schema import jobs
from meshdeform.requests.document import JobRequest
from tests.acceptance.cluster import SPHERE, Cluster, running_redis
from tests.acceptance.service import until
from tests.claims import claim_job
from tests.servers import PostgresServer

SHORT, ROUNDS, TURNS, POSTS = 1_000, 40, 2, 10
STEPS, STEP_S, EVENT_EVERY_S = 20, "0.5", 5.0


def first_job(cluster: Cluster) -> str:
    """Write the job of which those that wait are copies, and return its id; its file is stored, and it waits itself."""
    data = SPHERE.read_bytes()
    cluster.store.put("assets/first", data)
    file = StoredFile(key="assets/first", filename="a.glb", size=len(data), sha256=hashlib.sha256(data).hexdigest())
    params = {"steps": STEPS, "checkpoint_every_steps": STEPS}
    request = JobRequest.model_validate({"prompt": "a mushroom", "params": params})
    job = cluster.record.create(NewJob(request, {"asset": file}, owner_id="owner-0"))
    with cluster.record.database.write() as connection:
        later = cluster.record.database.now(86_400.0)
        connection.execute(sa.update(jobs).where(jobs.c.id == job.id).values(retry_at=later))
    return job.id


def ended(cluster: Cluster) -> float:
    """Return how many jobs have succeeded."""
    return cluster.record.counters().get(("jobs_ended", JobState.SUCCEEDED), 0.0)


def asked(cluster: Cluster) -> dict[str, float]:
    """Return the median seconds of each request of one client and of a claim, and the jobs ended per second."""
    http, asset = cluster.http, SPHERE.read_bytes()
    made = list[str]()

    def post() -> None:
        answer = http.post("/v1/jobs", files={"asset": ("sphere.glb", asset)}, data={"request": REQUEST})
        made.append(answer.raise_for_status().json()["id"])

    questions: dict[str, Callable[[], object]] = {
        "post": post,
        "get": lambda: http.get(f"/v1/jobs/{made[-1]}").raise_for_status(),
        "events": lambda: http.get(f"/v1/jobs/{made[-1]}/events", params={"format": "json"}).raise_for_status(),
        "list": lambda: http.get("/v1/jobs", params={"limit": 20}).raise_for_status(),
        "list queued": lambda: http.get("/v1/jobs", params={"limit": 20, "state": "queued"}).raise_for_status(),
        "claim and release": lambda: claim_and_release(cluster.record),
    }
    taken: dict[str, list[float]] = {name: [] for name in questions}
    before, began = ended(cluster), time.perf_counter()
    for _ in range(ROUNDS):
        for name, ask in questions.items():
            start = time.perf_counter()
            ask()
            taken[name].append(time.perf_counter() - start)
    rate = (ended(cluster) - before) / (time.perf_counter() - began)
    return {**{name: statistics.median(seconds) for name, seconds in taken.items()}, "jobs per second": rate}


def long_queue(cluster: Cluster, queued: int, workers: int) -> None:
    """Ask with a short queue and with a long one, beside workers."""
    like = first_job(cluster)
    fill_between(cluster.record, like, range(SHORT), 100)
    cluster.start_api()
    for number in range(workers):
        cluster._start(f"worker-{number}", [sys.executable, "-m", "tests.fake_worker"], {"FAKE_STEP_S": STEP_S})
    until("all work", lambda: len(cluster.record.list_jobs(JobState.RUNNING, limit=200).jobs) >= workers)
    settle(cluster.record)
    short = asked(cluster)
    fill_between(cluster.record, like, range(SHORT, queued), 100)
    settle(cluster.record)
    long = asked(cluster)
    print(f"{workers} workers, {queued} queued jobs relative to {SHORT}")
    for name, value in long.items():
        unit = "" if name == "jobs per second" else " ms"
        shown = [each if not unit else 1000 * each for each in (short[name], value)]
        print(f"{name:20}{shown[0]:>10.1f}{shown[1]:>10.1f}{unit}{value / short[name]:>8.1f}")


async def streamed(url: str, ids: list[str], meanwhile: Callable[[], object]) -> None:
    """Hold a stream of events on each job while something is done in a thread."""
    ready = asyncio.Semaphore(0)
    async with httpx.AsyncClient(base_url=url, timeout=300.0, limits=httpx.Limits(max_connections=len(ids))) as http:

        async def stream(job_id: str) -> None:
            async with http.stream("GET", f"/v1/jobs/{job_id}/events", params={"format": "stream"}) as answer:
                async for line in answer.aiter_lines():
                    if line == "event: queued":
                        ready.release()

        streams = [asyncio.create_task(stream(job_id)) for job_id in ids]
        for _ in ids:
            await ready.acquire()
        await asyncio.to_thread(meanwhile)
        for each in streams:
            each.cancel()
        await asyncio.gather(*streams, return_exceptions=True)


@contextlib.contextmanager
def progressing(cluster: Cluster, ids: list[str]) -> Iterator[None]:
    """Write progress of running jobs every five seconds, one after the other, while the block runs."""
    done = threading.Event()

    def write() -> None:
        for step in itertools.count(1):
            for job_id in ids:
                if done.wait(EVENT_EVERY_S / len(ids)):
                    return
                cluster.record.leases.save_progress(job_id, 1, Progress(step=step, total_steps=10**6))

    for job_id in ids:
        claim_job(cluster.record.leases, job_id, "worker", 3600.0)
    thread = threading.Thread(target=write)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def beside_streams(cluster: Cluster, streams: int, clients: int) -> None:
    """Post from clients without a pause, with and without streams."""
    cluster.start_api()
    url, ids = str(cluster.http.base_url), [cluster.submit() for _ in range(streams)]
    alone, beside = Clients(url), Clients(url)
    asyncio.run(Clients(url).post(clients, 1))  # the file's first check is a process of its own
    with progressing(cluster, ids):
        for _ in range(TURNS):
            asyncio.run(alone.post(clients, POSTS))
            asyncio.run(streamed(url, ids, lambda: asyncio.run(beside.post(clients, POSTS))))
    found = {}
    for name, posts in (("alone", alone), (f"beside {streams} streams", beside)):
        ordered = sorted(posts.seconds["create"])
        found[name] = statistics.median(ordered), ordered[int(0.99 * (len(ordered) - 1))]
        p50, p99 = found[name]
        print(f"{name:20} n {len(ordered)}, p50 {1000 * p50:.0f} ms, p99 {1000 * p99:.0f} ms, {dict(posts.odd) or ''}")
    (p50, _), (_, p99) = found.values()
    print(f"p99 beside streams / p50 without: {p99 / p50:.2f}")


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["queue", "streams"])
    parser.add_argument("--queued", type=int, default=100_000)
    parser.add_argument("--workers", type=int, default=50)
    parser.add_argument("--streams", type=int, default=100)
    parser.add_argument("--clients", type=int, default=20)
    options = parser.parse_args()
    os.environ["MESHDEFORM_STEP_TIMEOUT_S"] = "3600"
    with contextlib.ExitStack() as cleanup:
        base = Path(cleanup.enter_context(tempfile.TemporaryDirectory(prefix="meshdeform-crowds-", dir="/tmp")))
        base.chmod(0o755)
        (base / "postgres").mkdir()
        server = PostgresServer(base / "postgres", durable=True, options={"autovacuum": "off"})
        server.start()
        cleanup.callback(server.kill)
        redis = cleanup.enter_context(running_redis(base))
        cluster = Cluster(base, redis, database_url=server.url, environment={"MESHDEFORM_LEASE_S": "30"})
        cleanup.callback(cluster.clean_up)
        if options.what == "queue":
            long_queue(cluster, options.queued, options.workers)
        else:
            beside_streams(cluster, options.streams, options.clients)


if __name__ == "__main__":
    main()
