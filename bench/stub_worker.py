"""Workers with a stub in place of the deformation, for ``python -m bench.workers``; everything else in them is real.

    python -m bench.stub_worker --supervised     a supervisor with its worker process, as a deployment has them
    python -m bench.stub_worker --threads 100    so many workers in one process, when that many processes do not fit

A worker in a thread has what a worker process has: a record, a queue, RQ's loop, the watch over its job with its two
threads, and the reconciler of its supervisor. Only the pulse and the signals are missing.

The last word of a prompt is the duration of a step in seconds. Each step reports the time of its end as a loss, so
that a reader of the record can tell how old the newest progress is.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

from redis import Redis

from meshdeform.errors import MeshdeformError, UnavailableError
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.queue import JobQueue
from meshdeform.record.reconciler import Reconciler
from meshdeform.record.repository import JobRecord
from meshdeform.runs.base import RunInput, StepReport
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from tests.fake_kind import FakeKind
from worker.__main__ import main as supervise
from worker.attempt import JobRunner, WorkerContext
from worker.health import new_worker_id
from worker.process import Engine, InProcessWorker
from worker.process import main as work

STAMP = "ended_at"
"""The loss that holds the time of a step's end, in seconds since 1970."""


class _StampedRun:
    """A fake run whose steps last a fixed time and report when they ended."""

    def __init__(self, run: Any, step_s: float) -> None:
        self._run, self._step_s = run, step_s

    def __getattr__(self, name: str) -> Any:
        return getattr(self._run, name)

    def __iter__(self) -> Iterator[StepReport]:
        for report in self._run:
            time.sleep(self._step_s)
            yield StepReport(report.step, report.total_steps, {STAMP: time.time()})


class StubKind(FakeKind):
    """A kind of job that only waits."""

    def start(self, given: RunInput) -> Any:
        """Start a run with the step time that the prompt names."""
        self.started.clear()
        self.started_at.clear()
        return _StampedRun(super().start(given), float(given.request.prompt.split()[-1]))


def engine(settings: Settings) -> Engine:  # noqa: ARG001 - the signature of `torch_engine`
    """Take the place of `worker.process.torch_engine`."""
    return Engine(StubKind().start, lambda _: None, "cpu")  # type: ignore[arg-type, return-value]


class _ThreadedWorker(InProcessWorker):
    def _install_signal_handlers(self) -> None:
        """Leave signals to the process."""


class _Worker(threading.Thread):
    """One worker and the reconciler of its supervisor."""

    def __init__(self, settings: Settings, ending: threading.Event) -> None:
        super().__init__(daemon=True)
        self._settings, self._ending = settings, ending

    def run(self) -> None:
        """Work until the process ends."""
        settings = self._settings
        identity = WorkerIdentity(new_worker_id(), settings.queue, "cpu")
        record = _opened(settings, 1)
        queue = JobQueue(settings.redis_url, settings.queue)
        made = engine(settings)
        context = WorkerContext(
            settings=settings,
            record=record,
            store=ObjectStore(settings.resolved_storage_url),
            listen=queue.listen_for_cancel,
            start=made.start,
            load_prior=made.load_prior,
            device=made.device,
            stopping=self._ending.is_set,
            worker=identity,
            renew=lambda: None,
        )

        def idle() -> None:
            with contextlib.suppress(MeshdeformError):
                record.leases.idle(identity)

        supervising = _opened(settings, 0)
        limits = settings.max_attempts, settings.lease_s
        with Reconciler(supervising, queue, *limits, max_running=settings.max_running_jobs):
            listener = _ThreadedWorker(
                settings.queue,
                Redis.from_url(settings.redis_url),
                JobRunner(context).run,
                on_idle=idle,
                on_stop=lambda: None,
            )
            listener.work(logging_level="ERROR")


def _opened(settings: Settings, connections: int) -> JobRecord:
    """Return the record once it answers, as a supervisor does."""
    while True:
        with contextlib.suppress(UnavailableError):
            return JobRecord(settings.resolved_database_url, connections)
        time.sleep(1.0)


def _run_threads(count: int) -> None:
    threading.stack_size(256 * 1024)
    settings, ending = Settings(), threading.Event()
    for _ in range(count):
        _Worker(settings, ending).start()
    print("started", flush=True)
    # The parent closes standard input to end this process.
    sys.stdin.read()
    ending.set()


if __name__ == "__main__":
    if "--threads" in sys.argv[1:]:
        parser = argparse.ArgumentParser()
        parser.add_argument("--threads", type=int)
        _run_threads(parser.parse_args().threads)
    elif "--supervised" in sys.argv[1:]:
        supervise("bench.stub_worker")
    else:
        sys.exit(work(engine))
