"""The worker process: ``python -m worker.process``, started by the supervisor. It loads torch with its first optimiser.

RQ's worker loop is used as a notification: a message announces that some job is queued, and the record decides which. A
message is deleted as soon as it is read, before the job starts, so that RQ has nothing to time, retry or clean up, and
keeps no result. If the worker dies, the reconciler sends another message. Only public methods of RQ's worker are used
and overridden. While Redis is away, the worker asks the record for a job every two seconds instead. A Redis that
refuses is as good as away (`REDIS_AWAY`).

Whoever can write to Redis must not be able to run code here or to stop workers: functions and callbacks named in Redis
are never imported, and RQ's commands are ignored.
"""

from __future__ import annotations

import hashlib
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from redis import Redis
from rq import Queue
from rq.job import Job
from rq.serializers import JSONSerializer
from rq.worker import WorkerStatus
from rq.worker.base import BaseWorker, StopRequested
from rq.worker_registration import clean_worker_registry

from meshdeform.errors import MeshdeformError, UnavailableError
from meshdeform.priors.builtin.weights_file import MAX_FILE_BYTES
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.queue import MESSAGE, REDIS_AWAY, JobQueue, job_of
from meshdeform.record.repository import JobRecord
from meshdeform.requests.choices import is_weights_file
from meshdeform.requests.document import JobKind
from meshdeform.runs import kind_of, start_run
from meshdeform.runs.base import StartRun
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from meshdeform.support.memory import collection_paused
from meshdeform.support.telemetry import configure_logging, start_tracing, stop_tracing
from worker.attempt import JobRunner, WorkerContext
from worker.health import OUT_OF_MEMORY, STOP_GRACE_S, WORKER_ID, Pulse, new_worker_id

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

_log = logging.getLogger(__name__)
_WAIT_S = 10
"""Seconds to wait for a message before checking for a stop and renewing the worker's sign of life."""
_SILENT_REDIS_S = 415
"""Seconds without an answer on an open Redis connection before the process exits and is replaced. RQ's own value."""
_ASK_S = 2.0
"""Seconds between two questions to the record while Redis is away."""
_LONGEST_JOB_S = 86_400
"""Seconds that `rq info` lists a worker during one job: RQ's heartbeat is only renewed after the job."""


@dataclass(frozen=True)
class Engine:
    """The functions and the device that run jobs, created once per process. Priors are kept between jobs."""

    start: StartRun
    load_prior: Callable[[str], Prior]
    device: str


def torch_engine(settings: Settings) -> Engine:
    """Load what the first fit or change would wait for, and return the engine; torch is left to the first optimiser.

    `DependencyError`: the device named in the settings does not exist.
    """
    with collection_paused(keep=True):
        return _loaded(settings)


def _loaded(settings: Settings) -> Engine:
    from meshdeform.runs.devices import resolve_device, use_threads

    use_threads(settings.threads)
    device = resolve_device(settings.device)
    priors = PriorCache()

    def load_prior(model: str) -> Prior:
        revision = settings.model_revision if model == settings.model else ""
        return priors.get(model, device=device, revision=revision, dtype=settings.dtype)

    kind_of(JobKind.TEXT_DEFORM).load()  # now, so that the first job does not wait for it
    from meshdeform.runs.rehearsal import rehearse

    try:
        rehearse()
    except Exception:
        _log.exception("a small job failed; the next one may fail, too")
    return Engine(start_run, load_prior, device)


class PriorCache:
    """A cache of one prior, the last one used, so that only one is in memory."""

    def __init__(self) -> None:
        self._key: tuple[str, str, str, str] | None = None
        self._prior: Prior | None = None

    def get(self, model: str, *, device: str, revision: str = "", dtype: str = "auto") -> Prior:
        """Return the prior `model`, loading it unless it is cached; `ModelError`, `DependencyError`: it cannot load."""
        edition = _edition(model)
        key = (edition or model, device, revision, dtype)
        if self._prior is None or self._key != key:
            self._prior = None  # before the next one is loaded: two may not fit
            from meshdeform.priors import load_prior

            _log.info("loading the prior %s on %s", model, device)
            self._prior = load_prior(model, device=device, revision=revision, dtype=dtype)
            self._key = key
        return self._prior


def _edition(model: str) -> str:
    """Return the hash of a file of weights, which may be replaced; else an empty text."""
    if not is_weights_file(model):
        return ""
    path = Path(model).expanduser()
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            return ""
        with path.open("rb") as file:
            return f"{path.name} {hashlib.file_digest(file, 'sha256').hexdigest()}"
    except OSError:
        return ""


class InProcessWorker(BaseWorker):  # type: ignore[misc]
    """A worker for one queue that runs one job at a time in this process, which keeps the model in memory.

    `queue`: name of the RQ queue. `run`: runs the next job of the record; receives the id of the job for which the
    message was sent. `on_idle`: called before each wait for a message, every ten seconds while there is none.
    `on_stop`: called once, from the signal handler of SIGINT and SIGTERM. It must not block or take a lock: signals
    come in bursts, and one handler interrupts another. (When a supervisor dies, the kernel sends one signal for each of
    its threads that ends after the main thread.).
    """

    max_connection_wait_time = 5.0
    dequeue_timeout = _WAIT_S
    connection_timeout = _SILENT_REDIS_S

    def __init__(
        self,
        queue: str,
        connection: Redis,
        run: Callable[[str], None],
        *,
        on_idle: Callable[[], None],
        on_stop: Callable[[], None],
    ) -> None:
        self._run, self._on_idle, self._on_stop = run, on_idle, on_stop
        self._ending = self._last = False
        self.lost_redis = False
        """Whether the loop ended because Redis did not answer, or refused."""
        self._idle_at = 0.0
        super().__init__(
            [Queue(queue, connection=connection, serializer=JSONSerializer)],
            connection=connection,
            serializer=JSONSerializer,
        )

    def execute_job(self, job: Job, queue: Queue) -> None:
        """Delete the message; if it is ours, run the next job of the record."""
        with self._ending_without_redis():
            self.set_state(WorkerStatus.BUSY)
            self.heartbeat(_LONGEST_JOB_S)
            ours = _is_ours(job)
            job.delete()
            self.connection.lrem(queue.intermediate_queue_key, 1, job.id)
        if ours:
            self._run_next(job.id)
        else:
            _log.warning("message %s was not sent by Meshdeform; it is dropped", job.id)
        if self._ending or self._last:
            raise StopRequested

    def _run_next(self, message: str) -> None:
        try:
            self._run(job_of(message))
        except UnavailableError as error:
            _log.warning("message %s: nothing is claimed: %s", message, error.detail)
        except Exception:
            _log.exception("message %s", message)

    def dequeue_job_and_maintain_ttl(self, *args: Any, **kwargs: Any) -> Any:
        """Wait for a message; end the loop if Redis is away."""
        with self._ending_without_redis():
            return super().dequeue_job_and_maintain_ttl(*args, **kwargs)

    @contextmanager
    def _ending_without_redis(self) -> Iterator[None]:
        try:
            yield
        except REDIS_AWAY as error:
            self.lost_redis = True
            raise StopRequested from error

    def run_maintenance_tasks(self) -> None:
        """Remove dead workers from RQ's list. Unlike RQ's method, do not clean registries, which calls callbacks."""
        with self._ending_without_redis():
            for queue in self.queues:
                clean_worker_registry(queue)
        self.last_cleaned_at = datetime.now(UTC)

    def subscribe(self) -> None:
        """Do not listen for RQ's commands: whoever reaches Redis could stop workers with them.

        Signals stop a worker, and the record cancels a job.
        """

    def check_for_suspension(self, burst: bool) -> None:
        """Ignore `rq suspend`, which would keep every worker waiting for as long as one key is in Redis."""

    def request_stop(self, signum: int, frame: FrameType | None) -> None:  # noqa: ARG002 - RQ's signature
        """Stop after the job, which is stopped after its current step; without a job, stop at once.

        Unlike RQ's method, this does not use the Redis connection, which the interrupted code may be using.
        """
        if self._ending:
            return
        self._ending = True
        self._on_stop()
        if self.get_state() != WorkerStatus.BUSY:
            raise StopRequested

    def heartbeat(self, *args: Any, **kwargs: Any) -> None:
        """Renew this worker's entry in RQ; stop if requested, or if Redis is away. Called before each wait.

        A library that catches every exception may have swallowed the one raised by `request_stop`.
        """
        if self.get_state() == WorkerStatus.IDLE:
            if self._ending:
                raise StopRequested
            if time.monotonic() >= self._idle_at:
                self._idle_at = time.monotonic() + _WAIT_S / 2
                self._on_idle()
        with self._ending_without_redis():
            super().heartbeat(*args, **kwargs)

    def end_after_job(self) -> None:
        """Stop after the current job."""
        self._last = True


def _is_ours(job: Job) -> bool:
    try:
        return bool(job.func_name == MESSAGE)
    except Exception:  # whatever the serializer raises for bytes that it cannot read
        return False


def main(load_engine: Callable[[Settings], Engine] = torch_engine) -> int:
    """Run jobs until a signal stops the process; tests replace the function that loads the engine.

    The exit code is 0, or `OUT_OF_MEMORY` if the device needs a clean context.
    """
    settings = Settings()
    configure_logging(settings)
    start_tracing("worker")
    # Before RQ's loop starts, a signal ends the process at once: nothing has been claimed yet.
    pulse = Pulse.of_environment()
    process = _Process(settings, load_engine(settings), pulse)
    pulse.rest()
    try:
        process.run()
    except StopRequested:
        _log.debug("a signal came between two loops")
    finally:
        stop_tracing()
    return OUT_OF_MEMORY if process.spent and not process.stopping else 0


class _Process:
    """A worker that listens to Redis, or asks the record, until it is to stop or is spent."""

    def __init__(self, settings: Settings, engine: Engine, pulse: Pulse) -> None:
        self.stopping = self.spent = False
        self._redis_url, self._name = settings.redis_url, settings.queue
        self._worker = WorkerIdentity(os.environ.get(WORKER_ID) or new_worker_id(), settings.queue, engine.device)
        self._record = JobRecord(settings.resolved_database_url, connections=1)
        self._queue = JobQueue(settings.redis_url, settings.queue)
        self._listener: InProcessWorker | None = None
        context = WorkerContext(
            settings=settings,
            record=self._record,
            store=ObjectStore(settings.resolved_storage_url, create=not self._record.files.any()),
            listen=self._queue.listen_for_cancel,
            start=engine.start,
            load_prior=engine.load_prior,
            device=engine.device,
            stopping=lambda: self.stopping,
            worker=self._worker,
            renew=self._renew,
            pulse=pulse,
        )
        self._runner = JobRunner(context)
        _log.info("worker %d: device %s, queue %s", os.getpid(), engine.device, settings.queue)

    def run(self) -> None:
        """Run jobs; `StopRequested`: a signal came."""
        lost = False
        while not self._ended():
            run_without_redis(
                self._queue, self._runner, lost=lost, idle=self._idle, stop=self._stop, stopped=self._ended
            )
            if self._ended():
                break
            try:
                connection = Redis.from_url(self._redis_url)
                self._listener = InProcessWorker(
                    self._name, connection, self._runner.run, on_idle=self._idle, on_stop=self._stop
                )
                self._listener.work(logging_level="WARNING")
                lost = self._listener.lost_redis
            except REDIS_AWAY as error:
                _log.warning("this worker could not register with Redis, or deregister: %s", type(error).__name__)
                lost = True
            if not lost:
                break

    def _ended(self) -> bool:
        return self.stopping or self.spent

    def _stop(self) -> None:
        # This runs in a signal handler, which another signal may interrupt: it must not take a lock.
        self.stopping = True
        # If a step hangs and the supervisor is gone, only the kernel's alarm can end this process.
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(round(STOP_GRACE_S))

    def _renew(self) -> None:
        _log.warning("this process exits to free the device's memory")
        self.spent = True
        if self._listener is not None:
            self._listener.end_after_job()

    def _idle(self) -> None:
        if self.stopping:  # a signal that came before RQ's handlers were there
            raise StopRequested
        try:
            self._record.leases.idle(self._worker)
        except MeshdeformError as error:
            _log.warning("the record was not updated with this worker's sign of life: %s", error.detail)


def run_without_redis(
    queue: JobQueue,
    runner: JobRunner,
    *,
    lost: bool,
    idle: Callable[[], None],
    stop: Callable[[], None],
    stopped: Callable[[], bool],
) -> None:
    """Run jobs of the record, until Redis takes messages or the process is to stop.

    `lost`: whether it was just away. Then the record is asked first: a Redis may take messages and give none.
    """
    away = False
    while not stopped():
        if not lost and _takes_messages(queue):
            if away:
                _log.info("Redis is back")
            return
        if not away:
            _log.warning("Redis is away: this worker asks the record for jobs until it is back")
            for number in (signal.SIGINT, signal.SIGTERM):  # RQ's loop puts its own in their places
                signal.signal(number, lambda *_: stop())
        away, lost = True, False
        idle()
        try:
            runner.run("")
        except MeshdeformError as error:
            _log.warning("no job could be claimed: %s", error.detail)
        if not stopped():
            time.sleep(_ASK_S)


def _takes_messages(queue: JobQueue) -> bool:
    try:
        queue.ping()
    except UnavailableError:
        return False
    return True


if __name__ == "__main__":
    sys.exit(main())
