"""A whole deployment as plain processes that a test can kill, stop, cut off and start again, one by one.

Everything is real but the deformation, which is a sum (`tests/fake_kind.py`): what it gives is known beforehand, so a
result that went through any number of deaths can be compared with the one of an undisturbed run.
"""

from __future__ import annotations

import contextlib
import gc
import json
import logging
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import httpx
import psutil

from meshdeform.errors import UnavailableError
from meshdeform.record.models import Event, Job, JobState, NewJob, StoredFile
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from meshdeform.storage import ObjectStore
from tests.acceptance.service import until
from tests.servers import RedisServer, free_port

ROOT = Path(__file__).resolve().parents[2]
DEADLINE_S = 240.0
LEASE_S = 5.0
EVERY = 4
SPHERE = ROOT / "examples" / "sphere.glb"
API = (sys.executable, "-m", "meshdeform", "api", "--port")


def sum_after(steps: int) -> bytes:
    """What a job of so many steps gives, however often it was interrupted."""
    value = 1
    for step in range(1, steps + 1):
        value = value * 3 + step
    return str(value).encode()


class Part:
    """One process of the deployment, with its output in a file."""

    def __init__(self, name: str, command: list[str], environment: Mapping[str, str], log: Path) -> None:
        self.name, self._log = name, log
        with log.open("ab") as output:
            self.process = subprocess.Popen(
                command, env=dict(environment), stdin=subprocess.DEVNULL, stdout=output, stderr=output, cwd=ROOT
            )
        self.pid = self.process.pid

    @property
    def log(self) -> str:
        """What it has printed, and its forerunners of the same name."""
        return self._log.read_text(errors="replace")

    def children(self) -> list[psutil.Process]:
        """The processes below it."""
        with contextlib.suppress(psutil.NoSuchProcess):
            return psutil.Process(self.pid).children(recursive=True)
        return []

    def child(self) -> psutil.Process:
        """The worker process below a supervisor, as soon as there is one."""
        return until(f"a child of {self.name}", lambda: next(iter(self.children()), None))

    def send(self, number: signal.Signals) -> None:
        """Send it a signal."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it with SIGKILL, as the out-of-memory killer does; its children notice by themselves."""
        self.send(signal.SIGKILL)
        self.process.wait()

    def stop(self) -> int:
        """End it in order and return its exit code."""
        self.send(signal.SIGTERM)
        return self.process.wait(timeout=DEADLINE_S)

    def clean_up(self) -> None:
        """End it and everything below it, whatever state it is in."""
        family = self.children()
        self.kill()
        for process in family:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()


class Followed:
    """Jobs of `record` that a test waits for."""

    record: JobRecord

    @property
    def logs(self) -> str:
        """What all parts printed, for a failing test."""
        raise NotImplementedError

    def when(self, job_id: str, what: str, condition: Callable[[Job], bool]) -> Job:
        """Return the job as soon as the condition is true of it."""

        def look() -> Job | None:
            job = self.record.get(job_id)
            return job if condition(job) else None

        try:
            return until(what, look)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.story(job_id)}\n{self.logs}") from None

    def at_step(self, job_id: str, step: int) -> Job:
        """Return the job once it has done so many steps; it must still run."""
        job = self.when(job_id, f"step {step}", lambda job: job.state.terminal or job.progress.step >= step)
        assert job.state is JobState.RUNNING, f"too late: {job}"
        return job

    def finished(self, job_id: str) -> Job:
        """Return the job once it is over."""
        return self.when(job_id, "the end", lambda job: job.state.terminal)

    def events(self, job_id: str) -> list[Event]:
        """Everything that happened to the job."""
        return self.record.events.after(job_id, limit=100_000)

    def story(self, job_id: str) -> str:
        """What happened to the job, for a failing test."""
        return "\n".join(f"{e.seq} {e.at:%H:%M:%S.%f} {e.attempt} {e.type} {e.data}" for e in self.events(job_id))


class Cluster(Followed):
    """Record, Redis (which runs already), object store, API and supervisors.

    Without URLs, the record is a SQLite file and the store a folder, both in `folder`; `environment` is for every part.
    """

    def __init__(
        self,
        folder: Path,
        redis: RedisServer,
        *,
        database_url: str = "",
        storage_url: str = "",
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.folder, self.redis = folder, redis
        # What our own client of the record says while its server is down is no news, and a log that is kept would keep
        # the errors, which have the frames, which have the sockets.
        logging.disable()
        self._environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "MESHDEFORM_DATA_DIR": str(folder),
            "MESHDEFORM_DATABASE_URL": database_url or f"sqlite:///{folder / 'record.sqlite'}",
            "MESHDEFORM_STORAGE_URL": storage_url or str(folder / "objects"),
            "MESHDEFORM_REDIS_URL": redis.url,
            "MESHDEFORM_LEASE_S": f"{LEASE_S:g}",
            "MESHDEFORM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
            **(environment or {}),
        }
        self.record = JobRecord(self._environment["MESHDEFORM_DATABASE_URL"])
        self.store = ObjectStore(self._environment["MESHDEFORM_STORAGE_URL"])
        self.queue = JobQueue(self._environment["MESHDEFORM_REDIS_URL"], "meshdeform")
        self.parts: dict[str, Part] = {}
        self._port = free_port()
        self.http = httpx.Client(base_url=f"http://127.0.0.1:{self._port}", timeout=DEADLINE_S)
        self._asset: StoredFile | None = None

    def start_api(self, command: Sequence[str] = API, **environment: str) -> Part:
        """Start the API, by a command that ends with the port, and return when it answers."""
        part = self._start("api", [*command, str(self._port)], environment)
        until("the API answers", lambda: self.http.get("/healthz").status_code == 200)
        return part

    def start_worker(self, name: str = "worker", **environment: str) -> Part:
        """Start a supervisor, which starts its worker."""
        return self._start(name, [sys.executable, "-m", "tests.fake_worker", "--supervised"], environment)

    def _start(self, name: str, command: list[str], environment: Mapping[str, str]) -> Part:
        log = self.folder / f"{name}.log"
        self.parts[name] = Part(name, command, {**self._environment, **environment}, log)
        return self.parts[name]

    def post(self, steps: int = 12, *, every: int = EVERY, key: str = "", **more: Any) -> httpx.Response:
        """Post a job over HTTP that stores a checkpoint `every` so many steps."""
        request = {"prompt": "a mushroom", "params": {"steps": steps, "checkpoint_every_steps": every}, **more}
        headers = {"Idempotency-Key": key} if key else {}
        files = {"asset": ("sphere.glb", SPHERE.read_bytes())}
        return self.http.post("/v1/jobs", files=files, data={"request": json.dumps(request)}, headers=headers)

    def submit(self, steps: int = 12, *, every: int = EVERY, owner_id: str = "", **more: Any) -> str:
        """Record a job without the API and tell the queue if it can hear."""
        if self._asset is None:
            stored = self.store.put("assets/sphere", SPHERE.read_bytes())
            self._asset = StoredFile(key="assets/sphere", filename="sphere.glb", size=stored.size, sha256=stored.sha256)
        document = {"prompt": "a mushroom", "params": {"steps": steps, "checkpoint_every_steps": every}, **more}
        new = NewJob(JobRequest.model_validate(document), {"asset": self._asset}, owner_id=owner_id)
        job = self.record.create(new)
        with contextlib.suppress(UnavailableError):
            self.queue.enqueue(job.id)
        return job.id

    def put_to_sleep(self, process: psutil.Process) -> None:
        """SIGSTOP between two transactions: SQLite has nobody who could end the one of a process that sleeps."""

        def stopped() -> bool:
            process.send_signal(signal.SIGSTOP)
            if not self.record.database.is_sqlite:
                return True
            path = self._environment["MESHDEFORM_DATABASE_URL"].removeprefix("sqlite:///")
            with contextlib.closing(sqlite3.connect(path, timeout=0.5, isolation_level=None)) as connection:
                try:
                    connection.execute("BEGIN IMMEDIATE")
                    connection.execute("ROLLBACK")
                except sqlite3.OperationalError:
                    process.send_signal(signal.SIGCONT)
                    return False
            return True

        until("the process sleeps", stopped)

    def job(self, job_id: str) -> Job:
        """The job as it stands."""
        return self.record.get(job_id)

    @property
    def logs(self) -> str:
        """What all parts printed."""
        return "\n".join(f"--- {part.name}\n{part.log[-4000:]}" for part in self.parts.values())

    def check(self, job_id: str, *, steps: int = 12, state: JobState = JobState.SUCCEEDED) -> Job:
        """Wait for the end and hold the job against the promises: all of them that can be seen from outside."""
        job = self.finished(job_id)
        assert job.state is state, f"{job.error}\n{self.story(job_id)}\n{self.logs}"
        self.check_events(job_id)
        published = self.record.artifacts(job_id)
        if state is JobState.SUCCEEDED:
            assert [artifact.name for artifact in published] == ["result.glb"], self.story(job_id)
            result = self.store.get(published[0].key)
            assert result == sum_after(steps), f"not the uninterrupted result\n{self.story(job_id)}\n{self.logs}"
            assert f"/{job.attempt}/" in published[0].key
            assert job.progress.fraction == 1.0
        else:
            assert published == []
        return job

    def check_events(self, job_id: str) -> None:
        """Contiguous, one terminal event and that the last, a fraction that never goes back."""
        events = self.events(job_id)
        assert [event.seq for event in events] == list(range(1, len(events) + 1)), self.story(job_id)
        ends = [event.type.terminal for event in events]
        assert ends == [False] * (len(events) - 1) + [True], self.story(job_id)
        fractions = [event.data["fraction"] for event in events if event.type == "progress"]
        assert fractions == sorted(fractions), self.story(job_id)
        attempts = [event.attempt for event in events]
        assert attempts == sorted(attempts), self.story(job_id)

    def clean_up(self) -> None:
        """End everything that was started."""
        for part in self.parts.values():
            part.clean_up()
        self.http.close()
        self.queue.close()
        self.record.close()
        logging.disable(logging.NOTSET)
        gc.collect()


@contextlib.contextmanager
def running_redis(folder: Path) -> Iterator[RedisServer]:
    """A Redis for the block."""
    server = RedisServer(folder)
    server.start()
    try:
        yield server
    finally:
        server.stop()


@contextlib.contextmanager
def deployed(folder: Path, **options: Any) -> Iterator[Cluster]:
    """A deployment for the block, with nothing started but Redis."""
    with running_redis(folder) as redis:
        made = Cluster(folder, redis, **options)
        try:
            yield made
        finally:
            made.clean_up()
