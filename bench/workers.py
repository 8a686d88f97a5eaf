"""Count what workers ask of one PostgreSQL and one Redis: ``python -m bench.workers [--workers N ...]``.

    python -m bench.workers --workers 1 8 64                     a supervisor and a worker process each
    python -m bench.workers --workers 500 --threads 125          125 workers in each process
    python -m bench.workers --workers 64 --pooler                behind PgBouncer in transaction mode

PostgreSQL (with `pg_stat_statements`), Redis and PgBouncer are started here. The workers are real up to their steps,
which only wait (`bench.stub_worker`). Printed, for each number of workers:

* idle: connections, and per worker and second: statements (BEGIN and COMMIT among them), commits, commands to Redis,
  milliseconds of CPU time of PostgreSQL
* busy: the same, each worker with a job of its own, steps of `--step` seconds, a checkpoint every hundred; and the age
  of the newest progress in the record
* short jobs of one step: statements for each, jobs claimed per second, and how many jobs of an owner who has posted a
  thousand start before each job of another one who posts ten after that
* with the phase `api`: what an idle API process asks

`--top 10` lists the statements that PostgreSQL ran most often.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pg8000.native
from redis import Redis

from bench.stub_worker import STAMP
from meshdeform.record.models import NewJob, StoredFile
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from meshdeform.storage import ObjectStore
from tests.servers import PgBouncer, PostgresServer, RedisServer, free_port

_OWN = "bench_own"
"""An alias in the statements of this program, which are not counted."""
_OPTIONS = {
    "max_connections": "2500",
    "shared_preload_libraries": "pg_stat_statements",
    "pg_stat_statements.track_utility": "on",
    "pg_stat_statements.max": "10000",
    "log_min_messages": "fatal",
}
_MANY, _FEW = 1000, 10
_DEADLINE_S = 600.0


@dataclass(frozen=True)
class Count:
    """Running totals of the servers at one moment."""

    at: float
    statements: int
    commits: int
    commands: int
    cpu_s: float


class Servers:
    """The servers and the record on them, as a client of the service would use it."""

    def __init__(self, folder: Path, *, pooler: bool) -> None:
        for name in ("postgres", "redis", "pooler", "objects"):
            (folder / name).mkdir()
        folder.chmod(0o755)
        self._postgres = PostgresServer(folder / "postgres", options=_OPTIONS)
        self._postgres.start()
        self._redis = RedisServer(folder / "redis")
        self._redis.start()
        self._pooler = PgBouncer(folder / "pooler", self._postgres, connections=20) if pooler else None
        if self._pooler is not None:
            self._pooler.start()
        self._own = pg8000.native.Connection("meshdeform", port=self._postgres.port, database="template1")
        self._own.run("CREATE EXTENSION pg_stat_statements")
        self._commands = Redis.from_url(self._redis.url)
        url = self._postgres.url
        self.record, self.queue = JobRecord(url), JobQueue(self._redis.url, "meshdeform")
        self.store = ObjectStore(str(folder / "objects"))
        self.pid = self._postgres.pid
        self.environment = {
            **os.environ,
            "MESHDEFORM_DATABASE_URL": self._pooler.url if self._pooler else url,
            "MESHDEFORM_REDIS_URL": self._redis.url,
            "MESHDEFORM_STORAGE_URL": str(folder / "objects"),
            "MESHDEFORM_DATA_DIR": str(folder),
        }

    def count(self) -> Count:
        """Return the totals now."""
        ((statements,),) = self._own.run(
            "SELECT coalesce(sum(calls), 0)::bigint FROM pg_stat_statements AS bench_own JOIN pg_database d"
            " ON d.oid = dbid WHERE datname = 'postgres' AND query NOT LIKE '%bench_own%'"
        )
        ((commits,),) = self._own.run("SELECT xact_commit FROM pg_stat_database WHERE datname = 'postgres'")
        commands = self._commands.info("stats")["total_commands_processed"]  # type: ignore[index]
        return Count(time.monotonic(), int(statements), int(commits), int(commands), cpu_s(self.pid))

    def connections(self) -> tuple[int, int]:
        """Return how many clients PostgreSQL and Redis have, without those of this program."""
        ((clients,),) = self._own.run(
            "SELECT count(*) FROM pg_stat_activity WHERE backend_type = 'client backend' AND datname = 'postgres'"
        )
        own = self.record.database._engine.pool.checkedin()  # type: ignore[attr-defined]
        redis = self._commands.info("clients")["connected_clients"]  # type: ignore[index]
        return int(clients) - own, int(redis) - 2

    def top(self, count: int) -> None:
        """Print the statements that were run most often."""
        for calls, query in self._own.run(
            "SELECT calls, left(regexp_replace(query, '\\s+', ' ', 'g'), 150) FROM pg_stat_statements"
            " JOIN pg_database d ON d.oid = dbid WHERE datname = 'postgres' ORDER BY calls DESC LIMIT :most",
            most=count,
        ):
            print(f"    {calls:>8}  {query}")

    def reset(self) -> None:
        """Forget the statements so far."""
        self._own.run("SELECT pg_stat_statements_reset()")

    def post(self, owner: str, step_s: float, steps: int) -> str:
        """Post a job as the API does: the record first, then a message."""
        stored = self.store.put("assets/a", b"an asset", "model/gltf-binary")
        asset = StoredFile(key="assets/a", filename="a.glb", size=stored.size, sha256=stored.sha256)
        params = {"steps": steps, "checkpoint_every_steps": 100, "guidance": {"kind": "target"}}
        request = JobRequest.model_validate({"prompt": f"stub {step_s}", "params": params})
        job = self.record.create(NewJob(request, {"asset": asset, "target": asset}, owner_id=owner))
        self.queue.enqueue(job.id)
        return job.id

    def own(self, sql: str) -> list[Any]:
        """Run a query that is not counted."""
        with self.record.database.read() as connection:
            return list(connection.exec_driver_sql(f"{sql} /* {_OWN} */"))

    def close(self) -> None:
        """End everything."""
        self._own.close()
        self.queue.close()
        self.record.close()
        if self._pooler is not None:
            self._pooler.stop()
        self._redis.stop()
        self._postgres.kill()


def cpu_s(pid: int) -> float:
    """Return the CPU seconds of a process and its children, ended ones among them."""
    ticks, parents = {}, {}
    for folder in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError):
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            number = int(folder.name)
            parents[number] = int(fields[1])
            own, ended = sum(map(int, fields[11:13])), sum(map(int, fields[13:15]))
            ticks[number] = own + (ended if number == pid else 0)
    mine = [number for number in ticks if number == pid or parents[number] == pid]
    return sum(ticks[number] for number in mine) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def workers(servers: Servers, count: int, threads: int) -> Iterator[None]:
    """Run so many workers, and return once all have told the record of themselves."""
    module = [sys.executable, "-m", "bench.stub_worker"]
    if threads:
        sizes = [min(threads, count - first) for first in range(0, count, threads)]
        commands = [[*module, "--threads", str(size)] for size in sizes]
    else:
        commands = [[*module, "--supervised"]] * count
    silent = subprocess.DEVNULL
    children = [
        subprocess.Popen(command, env=servers.environment, stdin=subprocess.PIPE, stdout=silent, stderr=silent)
        for command in commands
    ]
    try:
        until(lambda: servers.own("SELECT count(*) FROM workers")[0][0] >= count)
        yield
    finally:
        for child in children:
            child.kill() if threads else child.terminate()
        for child in children:
            child.wait()
        with servers.record.database.write() as connection:
            connection.exec_driver_sql(f"DELETE FROM workers /* {_OWN} */")


def until(true: Callable[[], bool]) -> None:
    """Wait for a condition."""
    deadline = time.monotonic() + _DEADLINE_S
    while not true():
        if time.monotonic() > deadline:
            raise TimeoutError
        time.sleep(0.1)


def rates(servers: Servers, count: int, window_s: float) -> str:
    """Count for a while; return the rates per worker and second."""
    first = servers.count()
    time.sleep(window_s)
    last = servers.count()
    passed = (last.at - first.at) * count
    return (
        "  ".join(
            f"{name} {(getattr(last, name) - getattr(first, name)) / passed:.3f}"
            for name in ("statements", "commits", "commands")
        )
        + f"  PostgreSQL's CPU {(last.cpu_s - first.cpu_s) / passed * 1000:.2f} ms"
    )


def idle(servers: Servers, count: int, window_s: float) -> None:
    """Print what idle workers ask."""
    postgres, redis = servers.connections()
    print(f"  idle  connections {postgres} + {redis}  per worker and second: {rates(servers, count, window_s)}")


def busy(servers: Servers, count: int, window_s: float, step_s: float, steps: int) -> None:
    """Print what busy workers ask, and how old the newest progress is."""
    for number in range(count):
        servers.post(f"owner-{number % 5}", step_s, steps)
    until(lambda: servers.own("SELECT count(*) FROM jobs WHERE state = 'running' AND step > 0")[0][0] >= count)
    postgres, redis = servers.connections()
    found = rates(servers, count, window_s)
    lags = []
    for _ in range(10):
        rows = servers.own(f"SELECT losses->>'{STAMP}' FROM jobs WHERE state = 'running' AND phase = 'optimizing'")
        lags += [time.time() - float(row[0]) for row in rows if row[0]]
        time.sleep(0.3)
    print(f"  busy  connections {postgres} + {redis}  per worker and second: {found}")
    lags.sort()
    middle, most = statistics.median(lags), lags[int(0.99 * (len(lags) - 1))]
    print(f"        age of the newest progress: median {middle:.2f} s, 99 of 100 at most {most:.2f} s")
    for (job_id,) in servers.own("SELECT id FROM jobs WHERE state = 'running'"):
        servers.record.request_cancel(job_id)
        servers.queue.publish_cancel(job_id)
    until(lambda: servers.own("SELECT count(*) FROM jobs WHERE state IN ('running', 'canceling')")[0][0] == 0)


def short(servers: Servers, count: int, threads: int, many: int) -> None:
    """Print what short jobs cost, and whether one owner delays another. They are posted before the workers start."""
    for _ in range(many):
        servers.post("many", 0.0, 1)
    first = servers.count()
    with workers(servers, count, threads):
        until(lambda: servers.own("SELECT count(*) FROM jobs WHERE started_at IS NOT NULL")[0][0] >= many // 4)
        few = {servers.post("few", 0.0, 1) for _ in range(_FEW)}
        at_post = servers.own("SELECT count(*) FROM jobs WHERE owner_id = 'many' AND started_at IS NOT NULL")[0][0]
        until(lambda: servers.own("SELECT count(*) FROM jobs WHERE state IN ('queued', 'running')")[0][0] == 0)
        last = servers.count()
    ours = "owner_id IN ('many', 'few') ORDER BY started_at"
    rows = servers.own(f"SELECT id, owner_id, started_at FROM jobs WHERE {ours}")
    started = [row[0] in few for row in rows]
    before = [max(0, started[:place].count(False) - at_post) for place, mine in enumerate(started) if mine]
    each = (last.statements - first.statements) / len(rows)
    cpu_ms = (last.cpu_s - first.cpu_s) / len(rows) * 1000
    print(
        f"  short  {len(rows)} jobs, each {each:.1f} statements and {cpu_ms:.1f} ms of PostgreSQL's CPU;"
        f" {len(rows) / (rows[-1][2] - rows[0][2]).total_seconds():.1f} claimed per second;"
        f" starts of the other owner's jobs before each of the {_FEW} posted later: {before}"
    )
    with servers.record.database.write() as connection:
        connection.exec_driver_sql(f"DELETE FROM jobs /* {_OWN} */")


def api(servers: Servers, window_s: float) -> None:
    """Print what an API process without requests asks; it leads, since there is no other candidate."""
    command = [sys.executable, "-m", "meshdeform", "api", "--port", str(free_port())]
    child = subprocess.Popen(command, env=servers.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        until(lambda: servers.own("SELECT count(*) FROM leaders")[0][0] == 2)
        time.sleep(12.0)
        postgres, redis = servers.connections()
        print(f"API  connections {postgres} + {redis}  per second: {rates(servers, 1, window_s)}")
    finally:
        child.terminate()
        child.wait()


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 8])
    parser.add_argument("--threads", type=int, default=0, help="so many workers in each process (default: processes)")
    parser.add_argument("--pooler", action="store_true")
    parser.add_argument("--phases", nargs="+", default=["idle", "busy", "short"])
    parser.add_argument("--step", type=float, default=0.05)
    parser.add_argument("--steps", type=int, default=2400)
    parser.add_argument("--window", type=float, default=30.0)
    parser.add_argument("--jobs", type=int, default=_MANY)
    parser.add_argument("--top", type=int, default=0)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as ends:
        servers = Servers(Path(folder), pooler=chosen.pooler)
        ends.callback(servers.close)
        if "api" in chosen.phases:
            servers.reset()
            api(servers, chosen.window)
            servers.top(chosen.top)
            chosen.phases.remove("api")
        for count in chosen.workers:
            print(f"{count} workers" + (" behind PgBouncer" if chosen.pooler else ""), flush=True)
            asked = [phase for phase in chosen.phases if phase != "short"]
            if asked:
                with workers(servers, count, chosen.threads):
                    time.sleep(12.0)  # until every worker waits for a message
                    for phase in asked:
                        servers.reset()
                        if phase == "idle":
                            idle(servers, count, chosen.window)
                        else:
                            busy(servers, count, chosen.window, chosen.step, chosen.steps)
                        servers.top(chosen.top)
                        sys.stdout.flush()
            if "short" in chosen.phases:
                servers.reset()
                short(servers, count, chosen.threads, chosen.jobs)
                servers.top(chosen.top)
                sys.stdout.flush()


if __name__ == "__main__":
    main()
