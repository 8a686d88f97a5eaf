"""Take each dependency away from a running deployment: ``python -m bench.outages [--only WORDS]``.

    python -m bench.outages --seconds 20 --jobs 20     every fault of the table, for so long, beside so many jobs
    python -m bench.outages --chaos 10000 --pause 3 25      so many jobs under random kills and outages of the table
    python -m bench.outages --chaos 200 --real --pause 5 20   the same with the real run: a sphere, two steps
    python -m bench.outages --chaos 200 --upgrade COMMIT    begun by that commit, upgraded in the middle

Plain processes: two APIs, two workers with the default lease of 30 s (`--chaos`: 5 s), PostgreSQL behind PgBouncer,
Redis, and an S3 server behind a proxy that fails on demand. Jobs are posted over HTTP before the fault and during it,
each with an `Idempotency-Key`, and again until it is accepted; one in ten names its file by a URL of a slow host, and
may fail with `asset_not_fetched`. Then every other job must have ended once, with the result of
an undisturbed run (`Cluster.check`), and the record has no other. A row has the accepted jobs, those that ended so,
those lost (not ended, failed, or with another result) and twice (a second job of a key, or a second end), those that
took more than one attempt, the seconds from the end of the fault to the last job's end, and the slowest answer of
/readyz meanwhile. With `--upgrade` the parts of an earlier commit begin, on the migrated record, and give way one
after the other in the middle; the faults go on. Exits with 1 if anything was lost or twice.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from datetime import UTC, datetime
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import httpx
import psutil
import sqlalchemy as sa

from bench.upgrades import tree_of
from meshdeform.errors import MeshdeformError, UnavailableError
from meshdeform.record.models import Job, JobState
from tests.acceptance.chaos import Chaos
from tests.acceptance.cluster import ROOT, SPHERE, Cluster, Part, running_redis
from tests.acceptance.service import until
from tests.fault_proxy import FaultProxy
from tests.s3_server import s3_server
from tests.servers import PgBouncer, PostgresServer, free_port, kept_full, small_disk
from tests.shut_database import ShutDatabase
from tests.shut_redis import HALF_SHUT, shut_redis
from tests.shut_redis import WAYS as REDIS_WAYS

Fault = Callable[[], AbstractContextManager[object]]
WORKERS, APIS = ["one", "two"], ("api", "api2")
PATIENCE_S, BACKLOG, LONG = 480.0, 40, 500  # a job whose API died while it fetched ends after 360 s
POSTGRES = {"max_connections": "60", "superuser_reserved_connections": "0", "max_wal_size": "64MB"}
_FETCHED = 10
"""Of so many jobs, one names its file by a URL of a slow host."""
REAL = {"preset": "preview", "steps": 2, "checkpoint_every_steps": 1, "seed": 7}
REQUESTS = b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n" * 1000
TERMINATE = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = 'service'"


class Deployment(Cluster):
    """A cluster with two APIs, whose jobs are sums or, if there is an `expected` hash, small runs of the product."""

    real, expected, ports, slow_host = False, "", (0, 0), ""
    tree = ROOT
    """The sources of the parts that are started from now on."""

    def start_apis(self) -> None:
        """Start both, where they do not run."""
        self.ports = self.ports if all(self.ports) else (self._port, free_port())
        for name, port in zip(APIS, self.ports, strict=True):
            if name not in self.parts or self.parts[name].process.poll() is not None:
                command = [sys.executable, "-m", "meshdeform", "api", "--host", "127.0.0.1", "--port", str(port)]
                self._start(name, command, {})
        urls = [f"http://127.0.0.1:{port}/healthz" for port in self.ports]
        try:
            until("both answer", lambda: all(httpx.get(url).is_success for url in urls))
        except AssertionError:
            for name in APIS:
                part = self.parts[name]
                print(f"    {name}, status {part.process.poll()}, says last:", part.log[-2000:], sep="\n", flush=True)
            raise

    def start_worker(self, name: str = "worker", **environment: str) -> Part:
        """Start a supervisor with a worker of the kind that is tried."""
        if not self.real:
            return super().start_worker(name, **environment)
        return self._start(name, [sys.executable, "-m", "meshdeform", "worker"], environment)

    def _start(self, name: str, command: list[str], environment: Mapping[str, str]) -> Part:
        # Without the folder in which it is started, where this tree is.
        command = [command[0], "-P", *command[1:]]
        return super()._start(name, command, {**environment, "PYTHONPATH": str(self.tree)})

    def upgrade(self) -> None:
        """Put parts of this tree in the places of others, one after the other, as an operator does."""
        self.tree = ROOT
        for name in (*APIS, *WORKERS):
            part = self.parts[name]
            part.send(signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                part.process.wait(timeout=60.0)
            part.clean_up()
            if name in APIS:
                self.start_apis()
            else:
                self.start_worker(name)

    def check(self, job_id: str, *, steps: int = 12, state: JobState = JobState.SUCCEEDED) -> Job:
        """Hold the job against the promises; the result of a real one against the first one's."""
        if not self.real:
            return super().check(job_id, steps=steps, state=state)
        job = self.finished(job_id)
        assert job.state is state, f"{job.error}"
        self.check_events(job_id)
        results = {artifact.name: artifact.sha256 for artifact in self.record.artifacts(job_id)}
        self.expected = self.expected or results["result.glb"]
        assert results["result.glb"] == self.expected, "not the uninterrupted result"
        return job


class Outages:
    """The servers of one deployment, and all that can happen to them; each fault is a context in which it holds."""

    def __init__(self, stack: ExitStack, *, real: bool, settings: dict[str, str], upgrade: str = "") -> None:
        base = Path(tempfile.mkdtemp(prefix="meshdeform-outages-", dir="/tmp"))
        base.chmod(0o755)
        for name in ("disk", "pgbouncer", "s3"):
            (base / name).mkdir()
        self.disk = base / "disk"
        stack.enter_context(small_disk(self.disk, 700))
        self.postgres = self._new_postgres()
        stack.callback(lambda: self.postgres.kill())
        with sa.create_engine(self._url("meshdeform"), isolation_level="AUTOCOMMIT").connect() as connection:
            connection.execute(sa.text("CREATE ROLE operator LOGIN SUPERUSER"))
            connection.execute(sa.text("CREATE DATABASE service"))
        self.switch = stack.enter_context(FaultProxy(self.postgres.port))
        self.bouncer = PgBouncer(base / "pgbouncer", self.switch.port, 10)
        self.bouncer.start()
        stack.callback(self.bouncer.stop)
        server = stack.enter_context(s3_server(base / "s3"))
        server.make_bucket("outages")
        self.store = stack.enter_context(FaultProxy(server.port))
        behind = {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.store.port}"}
        os.environ.update(server.settings() | behind)  # this process looks into the store as well
        self.redis = stack.enter_context(running_redis(base))
        url = f"postgresql://meshdeform@127.0.0.1:{self.bouncer.port}/service"
        environment = {"MESHDEFORM_FETCH_NETWORKS": "127.0.0.0/8", **settings}
        bucket = "s3://outages/some/prefix"
        self.cluster = Deployment(base, self.redis, database_url=url, storage_url=bucket, environment=environment)
        self.cluster.real, self.cluster.slow_host = real, stack.enter_context(slow_host())
        stack.callback(self.cluster.clean_up)
        if upgrade:
            self.cluster.tree = tree_of(upgrade, base / "tree")
        self.start_parts()
        self.faults: dict[str, Fault] = {
            "PostgreSQL frozen": self._postgres_frozen,
            "PostgreSQL shut down and started": lambda: self._gone(self.postgres.stop, self.postgres.start),
            "PostgreSQL out of connections": self._out_of_connections,
            "PostgreSQL: every backend terminated each second": self._terminated,
            "PostgreSQL read-only": lambda: self._shut("read-only"),
            "PostgreSQL refuses the login": lambda: self._shut("no login"),
            "PostgreSQL's disk full": self._disk_full,
            "PostgreSQL: the primary killed, its standby promoted": self._failover,
            "PgBouncer killed": lambda: self._gone(self.bouncer.kill, self.bouncer.start),
            "both APIs killed": lambda: self._gone(self._kill_apis, self.cluster.start_apis),
            "Redis killed, back empty": lambda: self._gone(self.redis.kill, self.redis.start),
            "Redis hung": lambda: self._gone(self._hang_redis, self._wake_redis),
            **{f"Redis {way}": partial(shut_redis, self.redis.url, way) for way in (*REDIS_WAYS, HALF_SHUT)},
            "S3 refuses": lambda: self._gone(self.store.refuse, self.store.pass_through),
            "S3 hung": lambda: self._gone(self.store.hang, self.store.pass_through),
            "S3 answers 503": lambda: self._gone(self.store.error503, self.store.pass_through),
            "S3 answers 403": lambda: self._gone(self.store.error403, self.store.pass_through),
            "S3 answers NoSuchBucket": lambda: self._gone(self.store.no_bucket, self.store.pass_through),
            "a gateway answers 404 for S3": lambda: self._gone(self.store.error404, self.store.pass_through),
            "requests without an end on both APIs": self._pipelined,
            "both workers killed in the middle": lambda: self._gone(self._kill_workers, lambda: None),
        }

    def start_parts(self) -> list[str]:
        """Start every API and supervisor that does not run; return the names of those that had ended."""
        ended = [name for name, part in self.cluster.parts.items() if part.process.poll() is not None]
        self.cluster.start_apis()
        for name in WORKERS:
            if name in ended or name not in self.cluster.parts:
                self.cluster.start_worker(name)
        return ended

    def _new_postgres(self, standby_of: PostgresServer | None = None) -> PostgresServer:
        folder = Path(tempfile.mkdtemp(prefix="postgres-", dir=self.disk))
        server = PostgresServer(folder, durable=True, options=POSTGRES, standby_of=standby_of)
        server.start()
        return server

    def _url(self, user: str = "operator") -> str:
        return f"postgresql+pg8000://{user}@127.0.0.1:{self.postgres.port}/postgres"

    def _operator(self) -> sa.Engine:
        """Who works on the server itself, past the switch and PgBouncer."""
        return sa.create_engine(self._url(), isolation_level="AUTOCOMMIT", poolclass=sa.NullPool)

    @contextmanager
    def _gone(self, go: Callable[[], object], come: Callable[[], object]) -> Iterator[None]:
        try:
            go()
            yield
        finally:
            come()

    @contextmanager
    def _repeated(self, action: Callable[[], object], every_s: float) -> Iterator[None]:
        done = threading.Event()

        def repeat() -> None:
            while not done.wait(every_s):
                action()

        thread = threading.Thread(target=repeat)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()

    @contextmanager
    def _postgres_frozen(self) -> Iterator[None]:
        server = psutil.Process(self.postgres.pid)
        runner = server.parent() or server  # which stops as its child does
        frozen = [server]
        try:
            server.suspend()
            frozen = [runner, server, *server.children(recursive=True)]
            for process in frozen[2:]:
                with contextlib.suppress(psutil.NoSuchProcess):  # a session that has just ended
                    process.suspend()
            yield
        finally:
            for process in reversed(frozen):
                with contextlib.suppress(psutil.NoSuchProcess):
                    process.resume()

    @contextmanager
    def _pipelined(self) -> Iterator[None]:
        """Connections that send requests one after the other, and read no answer."""
        with ExitStack() as held:
            senders = list[socket.socket]()
            for port in self.cluster.ports * 5:
                with contextlib.suppress(OSError):
                    senders.append(held.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5.0)))
                    senders[-1].setblocking(False)

            def push() -> None:
                for sender in senders:
                    with contextlib.suppress(OSError):
                        while sender.send(REQUESTS):
                            pass

            with self._repeated(push, 0.2):
                yield

    @contextmanager
    def _out_of_connections(self) -> Iterator[None]:
        engine = self._operator()
        with ExitStack() as held, engine.connect() as operator:

            def take() -> None:
                operator.execute(sa.text(TERMINATE))
                with contextlib.suppress(sa.exc.DBAPIError):
                    while True:
                        held.enter_context(engine.connect())

            take()
            with self._repeated(take, 0.5):
                yield

    @contextmanager
    def _terminated(self) -> Iterator[None]:
        with self._operator().connect() as operator, self._repeated(lambda: operator.execute(sa.text(TERMINATE)), 1.0):
            yield

    @contextmanager
    def _shut(self, way: str) -> Iterator[None]:
        database = ShutDatabase(self._operator(), sa.make_url(self._url()).set(database="service"), "meshdeform")
        with self._gone(lambda: database.shut(way), lambda: database.open(way)):
            yield

    @contextmanager
    def _disk_full(self) -> Iterator[None]:
        with kept_full(self.disk / "ballast"):
            yield
        time.sleep(2.0)  # it starts again by itself, or ends because its log cannot be written
        try:
            self._operator().connect().close()
        except sa.exc.DBAPIError:
            self.postgres.kill()
            self.postgres.start()

    @contextmanager
    def _failover(self) -> Iterator[None]:
        """Replication is synchronous: with any other kind, a primary that dies takes what it has acknowledged along."""
        former, standby = self.postgres, self._new_postgres(self.postgres)
        follows = sa.text("SELECT count(*) FROM pg_stat_replication WHERE sync_state = 'sync'")
        with self._operator().connect() as operator:
            operator.execute(sa.text("ALTER SYSTEM SET synchronous_standby_names = '*'"))
            operator.execute(sa.text("SELECT pg_reload_conf()"))
            until("the standby follows", lambda: operator.execute(follows).scalar_one())
        former.kill()
        self.postgres = standby
        yield
        standby.promote()
        self.switch.lead_to(standby.port)
        shutil.rmtree(former.folder)

    def _hang_redis(self) -> None:
        os.kill(self.redis.pid, signal.SIGSTOP)

    def _wake_redis(self) -> None:
        os.kill(self.redis.pid, signal.SIGCONT)

    def _kill_apis(self) -> None:
        for name in APIS:
            self.cluster.parts[name].kill()

    def _kill_workers(self) -> None:
        until("a job runs", lambda: self.cluster.record.list_jobs(JobState.RUNNING, limit=1).jobs)
        for name in WORKERS:
            self.cluster.parts[name].child().kill()


class _SlowHost(BaseHTTPRequestHandler):
    """Sends the sphere after up to ten seconds."""

    def do_GET(self) -> None:
        time.sleep(random.uniform(0.0, 10.0))
        data = SPHERE.read_bytes()
        self.send_response(200)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        with contextlib.suppress(OSError):
            self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@contextmanager
def slow_host() -> Iterator[str]:
    """A URL of a slow host, while the block runs."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _SlowHost)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/sphere.glb"
    finally:
        server.shutdown()
        server.server_close()


class Jobs:
    """Jobs that were posted, with the steps of each, and what the APIs answered beside 202."""

    def __init__(self, cluster: Deployment, label: str) -> None:
        self._cluster, self._choose = cluster, random.Random(label)
        self._label = f"{re.sub('[^a-z]+', '-', label.lower())}-{time.time_ns()}"
        self.steps, self.answers, self.complaints = dict[str, int](), Counter[str](), list[str]()
        self.disturbed: Callable[[], None] = lambda: None
        """Raises what has ended the faults, after which nothing need work."""
        self.fetched = set[str]()  # jobs whose file comes from a slow host
        self.ended = self.lost = self.twice = self.again = self.not_fetched = 0
        self.last_end = datetime.min.replace(tzinfo=UTC)

    def post(self, number: int, steps: int) -> str:
        """Post one until it is accepted, and return its id."""
        params = REAL if self._cluster.real else {"steps": steps, "checkpoint_every_steps": 40}
        request = {"prompt": "a mushroom", "params": params, "metadata": {"row": self._label}}
        key, turns = f"{self._label}-{number}", iter(range(1_000_000))

        def accepted() -> str | None:
            self.disturbed()
            url = f"http://127.0.0.1:{self._cluster.ports[next(turns) % 2]}/v1/jobs"
            headers = {"Idempotency-Key": key}
            if number % _FETCHED == _FETCHED - 1:
                named = {**request, "asset": {"url": self._cluster.slow_host}}
                answer = httpx.post(url, json=named, headers=headers, timeout=60.0)
            else:
                files: dict[str, tuple[str | None, bytes | str]] = {
                    "asset": ("sphere.glb", SPHERE.read_bytes()),
                    "request": (None, json.dumps(request)),
                }
                answer = httpx.post(url, files=files, headers=headers, timeout=60.0)
            if answer.status_code in (200, 202):
                return str(answer.json()["id"])
            assert answer.status_code in (409, 429) or answer.is_server_error, answer.text
            self.answers[f"{answer.status_code} {answer.json().get('code')}"] += 1
            time.sleep(0.2)
            return None

        job_id = until("a job is accepted", accepted, deadline_s=PATIENCE_S)
        self.steps[job_id] = steps
        if number % _FETCHED == _FETCHED - 1:
            self.fetched.add(job_id)
        return job_id

    def post_many(self, numbers: range, every_s: float = 0.0) -> None:
        """Post so many, not faster than that."""
        for number in numbers:
            self.post(number, self._choose.choice([20, 50, 100, 150]))
            time.sleep(every_s)

    def unfinished(self, among: list[str]) -> list[str]:
        """Those that are not over."""
        return [job_id for job_id in among if not self._cluster.job(job_id).state.terminal]

    def hold_to_account(self) -> None:
        """Wait for the end of all, and count."""
        deadline, waiting = time.monotonic() + PATIENCE_S, list(self.steps)
        while waiting and time.monotonic() < deadline:
            with contextlib.suppress(UnavailableError):
                waiting = self.unfinished(waiting)
            time.sleep(0.2)
        for job_id, steps in self.steps.items():
            ends = [event for event in self._cluster.events(job_id) if event.type.terminal]
            self.twice += len(ends) > 1
            try:
                job = self._cluster.job(job_id)
                assert ends, f"not over: {job.state}, {job.progress.phase}"
                if job_id in self.fetched and job.error is not None and job.error.code == "asset_not_fetched":
                    self.not_fetched += 1  # as is said of a server that dies meanwhile
                    continue
                job = self._cluster.check(job_id, steps=steps)
            except (AssertionError, MeshdeformError) as error:
                self.lost += 1
                self.complaints += [f"{job_id}: {str(error).splitlines()[0]}", self._cluster.story(job_id)]
                continue
            self.ended += 1
            self.again += job.attempt > 1
            self.last_end = max(self.last_end, ends[0].at)
        self.twice += len(set(self._recorded()) - set(self.steps))

    def _recorded(self) -> Iterator[str]:
        """Give the ids of all jobs of these requests that the record has."""
        cursor: str | None = ""
        while cursor is not None:
            page = self._cluster.record.list_jobs(cursor=cursor or None, limit=100, metadata={"row": self._label})
            yield from (job.id for job in page.jobs)
            cursor = page.next_cursor


def row(outages: Outages, name: str, count: int, seconds: float) -> bool:
    """Let one fault happen beside so many jobs, print its row, and return whether all is well."""
    cluster = outages.cluster
    jobs, before = Jobs(cluster, name), {part: len(cluster.parts[part].log) for part in cluster.parts}
    jobs.post(0, LONG)  # runs when the fault comes, however long the others take to be accepted
    jobs.post_many(range(1, count // 2))
    every_s = seconds / max(1, count - count // 2)
    poster = threading.Thread(target=jobs.post_many, args=(range(count // 2, count), every_s))
    with outages.faults[name]():
        poster.start()
        slowest = readiness(cluster, seconds)
    over = datetime.now(UTC)
    poster.join()
    jobs.hold_to_account()
    after = max(0.0, (jobs.last_end - over).total_seconds())
    jobs.lost += count - len(jobs.steps)
    counts = f"{count} | {jobs.ended} | {jobs.lost} | {jobs.twice} | {jobs.again}"
    print(f"| {name} | {counts} | {after:.1f} s | {slowest:.1f} s |", flush=True)
    for line in jobs.complaints:
        print(f"    {line}")
    strange = {answer: times for answer, times in jobs.answers.items() if not answer.startswith(("503", "409"))}
    for text in [f"{times} answers {answer}" for answer, times in strange.items()]:
        print(f"    {text}")
    for part, start in before.items():
        if "Traceback" in (new := cluster.parts[part].log[start:]):
            errors = re.findall(r"(?m)^[\w.]+Error: .*", new)
            print(f"    {part} printed a traceback: {'; '.join(errors[-1:])}")
    for part in outages.start_parts():
        print(f"    {part} ended by itself")
    return not jobs.lost and not jobs.twice


def readiness(cluster: Deployment, seconds: float) -> float:
    """Ask both APIs for their readiness for so long, and return the seconds of the slowest answer."""
    slowest, end = 0.0, time.monotonic() + seconds
    while (start := time.monotonic()) < end:
        for port in cluster.ports:
            with contextlib.suppress(httpx.TransportError):
                httpx.get(f"http://127.0.0.1:{port}/readyz", timeout=60.0)
            slowest, start = max(slowest, time.monotonic() - start), time.monotonic()
        time.sleep(0.25)
    return slowest


def chaos(outages: Outages, count: int, seed: int, pause_s: tuple[float, float], minutes: float) -> bool:
    """Run so many jobs under random faults, so far apart; print what happened, and return whether all is well.

    After so many minutes no more are posted.
    """
    cluster, choose, jobs = outages.cluster, random.Random(seed), Jobs(outages.cluster, "chaos")
    if cluster.real:
        cluster.check(jobs.post(count, 0))  # the undisturbed one

    def briefly(fault: Fault) -> None:
        with fault():
            time.sleep(choose.uniform(0.5, 5.0))

    more = {name: lambda fault=fault: briefly(fault) for name, fault in outages.faults.items()}
    waiting, start, upgrades = list[str](), time.monotonic(), cluster.tree != ROOT
    with Chaos(cluster, seed, WORKERS, pause_s=pause_s, more=more) as faults:
        jobs.disturbed = faults.check
        for number in range(count):
            if time.monotonic() - start > 60.0 * minutes:
                break
            while len(waiting) >= BACKLOG:
                time.sleep(0.5)
                faults.check()
                with contextlib.suppress(UnavailableError):
                    waiting = jobs.unfinished(waiting)
            if upgrades and (number >= count // 2 or time.monotonic() - start > 30.0 * minutes):
                faults.next("an upgrade", cluster.upgrade)
                upgrades = False
            waiting.append(jobs.post(number, choose.choice([4, 8, 12, 20, 40])))
            if number % 100 == 99:
                so_far = f"{sum(faults.faults.values())} faults, {time.monotonic() - start:.0f} s"
                print(f"    {number + 1} accepted after {so_far}", flush=True)
    outages.start_parts()
    jobs.hold_to_account()
    total = sum(faults.faults.values())
    print(f"seed {seed}: {total} faults in {time.monotonic() - start:.0f} s {dict(faults.faults)}")
    print(f"jobs {len(jobs.steps)}, ended {jobs.ended}, lost {jobs.lost}, twice {jobs.twice}, again {jobs.again}")
    print(f"of {len(jobs.fetched)} from a slow host, {jobs.not_fetched} not fetched")
    print(f"answers beside 202: {dict(jobs.answers)}", *jobs.complaints, sep="\n    ")
    return not jobs.lost and not jobs.twice


def main() -> None:
    """Try them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="words in the names of the faults to try; default: every fault")
    parser.add_argument("--jobs", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=20.0, help="how long a fault lasts")
    parser.add_argument(
        "--chaos", type=int, default=0, metavar="N", help="N jobs under random faults, in place of the table"
    )
    parser.add_argument("--real", action="store_true", help="with --chaos: the real run in place of a sum")
    parser.add_argument(
        "--pause", type=float, nargs=2, default=(0.5, 4.0), metavar=("LEAST", "MOST"), help="seconds between two faults"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--upgrade", default="", metavar="COMMIT", help="with --chaos: the parts that begin")
    parser.add_argument("--minutes", type=float, default=math.inf, help="with --chaos: post no jobs after them")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # ends what was started
    settings = {"FAKE_STEP_S": "0.02"}
    if options.chaos:
        settings = {"MESHDEFORM_LEASE_S": "5", "MESHDEFORM_MAX_ATTEMPTS": "100", "FAKE_STEP_S": "0.01"}
    with ExitStack() as stack:
        settings = {"MESHDEFORM_LEASE_S": "30", **settings}
        outages = Outages(stack, real=options.real, settings=settings, upgrade=options.upgrade)
        if options.chaos:
            print("The clock is not set here: tests/integration/test_reconciler.py sets the record's.")
            well = chaos(outages, options.chaos, options.seed, tuple(options.pause), options.minutes)
        else:
            print(
                "| fault | jobs | ended | lost | twice | attempts > 1 | all ended after | slowest /readyz |\n|---|"
                + "---|" * 7
            )
            well = True
            for name in outages.faults:
                if options.only in name:
                    well = row(outages, name, options.jobs, options.seconds) and well
    sys.exit(0 if well else 1)


if __name__ == "__main__":
    main()
