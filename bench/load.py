"""Measure one API process with two hundred clients and ten thousand jobs in its record.

    python -m bench.load                          PostgreSQL and Redis, both started here
    python -m bench.load --jobs 1000 --clients 50 --rounds 1 --pause 0.5      a minute
    python -m bench.load --pause 0                200 clients that never pause: the most that one process can answer

Each of the `--clients` (200) creates a job, and then asks `--rounds` times for two jobs, for events and for a list.
Prints p50 and p99 of creating, getting and following jobs, each also relative to a single client in the same run, the
CPU time that the API spends on one of each kind, its memory before and after, and all unexpected answers. No worker
runs: the jobs stay queued, so only the API, its database and Redis are measured. They share the machine with the
clients.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import random
import statistics
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import psutil
import sqlalchemy as sa

from meshdeform.record import rows
from meshdeform.record.ids import new_job_id
from meshdeform.record.models import JobState, NewJob, StoredFile
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import events, jobs
from meshdeform.requests.document import JobRequest
from tests.acceptance.cluster import SPHERE, Cluster, running_redis
from tests.servers import PostgresServer

JOBS, CLIENTS, ALONE = 10_000, 200, 40
QUEUED = 100
REQUEST = json.dumps({"prompt": "a mushroom", "params": {"preset": "preview"}})


def seed(record: JobRecord, count: int) -> list[str]:
    """Write the jobs, almost all finished, with five events each; return the ids of some of them."""
    file = StoredFile(key="assets/" + "a" * 64, filename="a.glb", size=1, sha256="a" * 64)
    request = JobRequest.model_validate_json(REQUEST)
    ids = [new_job_id() for _ in range(count)]
    with record.database.write() as connection:
        for start in range(0, count, 500):
            batch, told = [], []
            for number, job_id in enumerate(ids[start : start + 500], start):
                over = number < count - min(QUEUED, count // 2)
                row = rows.new_job(job_id, NewJob(request, {"asset": file}), record.database.now(), None)
                row["created_at"] = sa.func.now()
                batch.append({**row, "state": JobState.SUCCEEDED if over else JobState.QUEUED, "event_seq": 5})
                kinds = ("queued", "started", "progress", "progress", "succeeded" if over else "queued")
                told += [
                    {"job_id": job_id, "seq": seq, "type": kind, "attempt": 1, "data": {}, "at": row["created_at"]}
                    for seq, kind in enumerate(kinds, 1)
                ]
            connection.execute(sa.insert(jobs).values(batch))
            for first in range(0, len(told), 500):
                connection.execute(sa.insert(events).values(told[first : first + 500]))
    return ids


class Clients:
    """Clients of one API, and the durations of their requests."""

    def __init__(self, url: str, pause_s: float = 0.0) -> None:
        self._pause_s = pause_s
        self._url, self.seconds, self.odd = url, defaultdict[str, list[float]](list), Counter[str]()
        self._asset = SPHERE.read_bytes()

    async def run(self, count: int, ids: list[str], rounds: int) -> None:
        """Run `count` clients concurrently."""
        limits = httpx.Limits(max_connections=count, max_keepalive_connections=count)
        async with httpx.AsyncClient(base_url=self._url, timeout=300.0, limits=limits) as http:
            await asyncio.gather(*(self._client(http, number, ids, rounds) for number in range(count)))

    async def post(self, count: int, rounds: int) -> None:
        """Let `count` clients create so many jobs each, one after the other."""
        limits, files = httpx.Limits(max_connections=count), {"asset": ("sphere.glb", self._asset)}
        async with httpx.AsyncClient(base_url=self._url, timeout=300.0, limits=limits) as http:

            async def client() -> None:
                for _ in range(rounds):
                    await self._timed(
                        "create", 202, lambda: http.post("/v1/jobs", files=files, data={"request": REQUEST})
                    )

            await asyncio.gather(*(client() for _ in range(count)))

    async def _client(self, http: httpx.AsyncClient, number: int, ids: list[str], rounds: int) -> None:
        files = {"asset": ("sphere.glb", self._asset)}
        made = await self._timed("create", 202, lambda: http.post("/v1/jobs", files=files, data={"request": REQUEST}))
        mine = made.json()["id"] if made is not None and made.status_code == 202 else ids[-1]
        for turn in range(rounds):
            other = ids[(number * 7919 + turn * 104_729) % len(ids)]
            await self._timed("get", 200, partial(http.get, f"/v1/jobs/{other}"))
            await self._timed("get", 200, lambda: http.get(f"/v1/jobs/{mine}"))
            await self._timed("events", 200, partial(http.get, f"/v1/jobs/{other}/events", params={"format": "json"}))
            await self._timed("list", 200, lambda: http.get("/v1/jobs", params={"limit": 20}))

    async def _timed(
        self, what: str, expected: int, send: Callable[[], Awaitable[httpx.Response]]
    ) -> httpx.Response | None:
        await asyncio.sleep(self._pause_s * random.uniform(0.5, 1.5))
        start = time.perf_counter()
        try:
            answer = await send()
        except httpx.TransportError as error:
            self.odd[f"{what}: {type(error).__name__}"] += 1
            return None
        self.seconds[what].append(time.perf_counter() - start)
        if answer.status_code != expected:
            self.odd[f"{what}: {answer.status_code}"] += 1
        return answer


async def follow(url: str, job_id: str, count: int) -> float:
    """Open `count` event streams on one job, cancel it, and return the largest delay in seconds."""
    heard: list[float] = []
    ready = asyncio.Semaphore(0)
    limits = httpx.Limits(max_connections=count + 1)
    async with httpx.AsyncClient(base_url=url, timeout=300.0, limits=limits) as http:

        async def stream() -> None:
            headers = {"Accept": "text/event-stream"}
            async with http.stream("GET", f"/v1/jobs/{job_id}/events", headers=headers) as answer:
                async for line in answer.aiter_lines():
                    if line == "event: queued":
                        ready.release()
                    if line == "event: canceled":
                        heard.append(time.perf_counter())
                        return

        streams = [asyncio.create_task(stream()) for _ in range(count)]
        for _ in range(count):
            await ready.acquire()
        start = time.perf_counter()
        await http.post(f"/v1/jobs/{job_id}/cancel")
        await asyncio.gather(*streams)
    return max(heard) - start


def cpu_times(url: str, api: psutil.Process, ids: list[str]) -> dict[str, float]:
    """Return the milliseconds of the API's CPU time for one request of each kind, from one client."""
    asset = SPHERE.read_bytes()
    found = {}
    with httpx.Client(base_url=url, timeout=300.0) as http:
        kinds: dict[str, Callable[[int], httpx.Response]] = {
            "healthz": lambda _: http.get("/healthz"),
            "create": lambda _: http.post(
                "/v1/jobs", files={"asset": ("sphere.glb", asset)}, data={"request": REQUEST}
            ),
            "get": lambda n: http.get(f"/v1/jobs/{ids[n]}"),
            "events": lambda n: http.get(f"/v1/jobs/{ids[n]}/events", params={"format": "json"}),
            "list": lambda _: http.get("/v1/jobs", params={"limit": 20}),
        }
        for name, send in kinds.items():
            send(0)  # the file's first check is a process of its own
            before = sum(api.cpu_times()[:2])
            for number in range(ALONE):
                send(number).raise_for_status()
            found[name] = 1000 * (sum(api.cpu_times()[:2]) - before) / ALONE
    return found


def report(alone: Clients, many: Clients) -> None:
    """Print the measurements."""
    print(f"{'':8}{'n':>7}{'p50 ms':>10}{'p99 ms':>10}{'p50 / alone':>14}")
    for what, seconds in many.seconds.items():
        ordered = sorted(seconds)
        p50, p99 = statistics.median(ordered), ordered[int(0.99 * (len(ordered) - 1))]
        ratio = p50 / statistics.median(alone.seconds[what])
        print(f"{what:8}{len(ordered):>7}{1000 * p50:>10.1f}{1000 * p99:>10.1f}{ratio:>14.1f}")
    print("unexpected answers:", dict(many.odd) or "none")


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="rounds per client")
    parser.add_argument("--clients", type=int, default=CLIENTS)
    parser.add_argument("--jobs", type=int, default=JOBS, help="jobs in the record before")
    parser.add_argument(
        "--pause", type=float, default=2.0, help="mean seconds between two requests of a client; 0: no pause"
    )
    options = parser.parse_args()
    base = Path(tempfile.mkdtemp(prefix="meshdeform-load-", dir="/tmp"))
    base.chmod(0o755)
    with contextlib.ExitStack() as cleanup:
        redis = cleanup.enter_context(running_redis(base))
        (base / "postgres").mkdir()
        server = PostgresServer(base / "postgres", durable=True)
        server.start()
        cleanup.callback(server.kill)
        cluster = Cluster(base, redis, database_url=server.url)
        cleanup.callback(cluster.clean_up)
        ids = seed(cluster.record, options.jobs)
        api = psutil.Process(cluster.start_api().pid)
        url = str(cluster.http.base_url)
        alone, many, again = Clients(url), Clients(url, options.pause), Clients(url, options.pause)
        spent = cpu_times(url, api, ids)
        for _ in range(5):
            asyncio.run(alone.run(1, ids, 4 * options.rounds))
        memory: list[Any] = [api.memory_info().rss]
        asyncio.run(many.run(options.clients, ids, options.rounds))
        memory.append(api.memory_info().rss)
        asyncio.run(again.run(options.clients, ids, options.rounds))
        memory.append(api.memory_info().rss)
        print(f"{options.clients} clients, each with a request every {options.pause:g} s")
        report(alone, many)
        print("CPU ms of the API for one:", ", ".join(f"{name} {cost:.1f}" for name, cost in spent.items()))
        delay = asyncio.run(follow(url, ids[-1], options.clients))
        print(f"{options.clients} event streams on one job: the slowest received its end after {delay:.2f} s")
        print("API memory in MB, before, after, and after the same again:", [round(size / 1e6) for size in memory])


if __name__ == "__main__":
    main()
