"""A worker's surroundings for the unit tests: a real record and a real store, and a kind of job that takes no time."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from meshdeform.errors import UnavailableError
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.models import Job, NewJob, Origin, StoredFile
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs.base import StartRun
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from tests.fake_kind import FakeKind
from worker.attempt import JobRunner, WorkerContext

__all__ = ["EVERY", "STEPS", "World", "away", "fail_for_a_while", "new_world", "working"]

STEPS, EVERY = 50, 10


class World:
    """A worker's surroundings."""

    def __init__(self, folder: Path) -> None:
        self.record = JobRecord(f"sqlite:///{folder / 'record.sqlite'}")
        self.store = ObjectStore(str(folder / "objects"))
        self.kind = FakeKind()
        self.priors: list[str] = []
        self.renewals: list[str] = []
        self.stop = False

    def runner(self, **changes: Any) -> JobRunner:
        context = WorkerContext(
            settings=Settings(),
            record=self.record,
            store=self.store,
            listen=self._listen,
            start=self.kind.start,
            load_prior=self._load_prior,
            device="cpu",
            stopping=lambda: self.stop,
            worker=WorkerIdentity("a worker", "meshdeform", "cpu"),
            renew=lambda: self.renewals.append("now"),
            retry_for_s=60.0,
        )
        return JobRunner(dataclasses.replace(context, **changes))

    def create(
        self,
        *,
        origin: Origin | None = None,
        priority: int = 0,
        deadline_s: float | None = None,
        max_run_s: float | None = None,
        **params: Any,
    ) -> Job:
        data = b"an asset"
        stored = self.store.put("assets/a", data, "model/gltf-binary")
        asset = StoredFile(key="assets/a", filename="a.glb", size=stored.size, sha256=stored.sha256)
        params = grouped({"steps": STEPS, "checkpoint_every_steps": EVERY, "guidance": "target", **params})
        document = {"prompt": "a vase", "params": grouped(params), "priority": priority, "deadline_s": deadline_s}
        document["max_run_s"] = max_run_s
        files = {"asset": asset, "target": asset}
        return self.record.create(NewJob(JobRequest.model_validate(document), files, origin=origin))

    def expire(self, job: Job) -> None:
        """Let the lease of whoever has the job be over."""
        self.record.leases.heartbeat(job.id, self.record.get(job.id).attempt, -1.0)

    def run(self, job: Job) -> Job:
        self.runner().run(job.id)
        return self.record.get(job.id)

    def result(self, job: Job) -> bytes:
        (artifact,) = self.record.artifacts(job.id)
        return self.store.get(artifact.key)

    def kept(self, job: Job) -> list[int]:
        return [reference.step for reference in self.record.leases.checkpoints(job.id)]

    def _load_prior(self, model: str) -> Any:
        self.priors.append(model)
        return object()

    @contextlib.contextmanager
    def _listen(self, job_id: str) -> Iterator[Any]:
        yield _Deaf()


class _Deaf:
    def wait(self, timeout_s: float) -> bool:
        time.sleep(min(timeout_s, 0.005))
        return False


@contextlib.contextmanager
def new_world(folder: Path) -> Iterator[World]:
    """A world for the block."""
    world = World(folder)
    yield world
    world.record.close()


@contextlib.contextmanager
def working(
    settings: Settings, start: StartRun, load_prior: Callable[[str], Any] = lambda _model: object()
) -> Iterator[None]:
    """Run the jobs of a real service, one after the other, in a thread of this process."""
    record, store = JobRecord(settings.resolved_database_url), ObjectStore(settings.resolved_storage_url)
    ended = threading.Event()
    context = WorkerContext(
        settings=settings,
        record=record,
        store=store,
        listen=lambda job_id: contextlib.nullcontext(_Deaf()),
        start=start,
        load_prior=load_prior,
        device="cpu",
        stopping=ended.is_set,
        worker=WorkerIdentity("a thread", settings.queue, "cpu"),
        renew=ended.set,
    )

    def work() -> None:
        while not ended.wait(0.02):
            JobRunner(context).run("any")

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        record.close()


def away(*_: Any, **__: Any) -> Any:
    """Take the place of a method of something that does not answer."""
    raise UnavailableError("It does not answer.")


def fail_for_a_while(patch: pytest.MonkeyPatch, part: Any, method: str, times: int) -> list[str]:
    """Let the first calls of a method fail; the calls are remembered."""
    calls: list[str] = []
    real = getattr(part, method)

    def flaky(*arguments: Any, **named: Any) -> Any:
        calls.append(method)
        return away() if len(calls) <= times else real(*arguments, **named)

    patch.setattr(part, method, flaky)
    return calls
