"""RQ's worker loop, used as a notification: a message announces that some job is queued, and the record decides which.

A message is deleted as soon as it is read, before the job starts, so that RQ has nothing to time, retry or clean up,
and keeps no result. If the worker dies, the reconciler sends another message. Only public methods of RQ's worker are
used and overridden.

Whoever can write to Redis must not be able to run code here or to stop workers: functions and callbacks named in Redis
are never imported, and RQ's commands are ignored.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime
from types import FrameType
from typing import Any

from redis import Redis
from rq import Queue
from rq.job import Job
from rq.serializers import JSONSerializer
from rq.worker import WorkerStatus
from rq.worker.base import BaseWorker, StopRequested
from rq.worker_registration import clean_worker_registry

from meshdeform.record.queue import MESSAGE, job_of

__all__ = ["InProcessWorker"]

_log = logging.getLogger(__name__)
_WAIT_S = 10
"""Seconds to wait for a message before checking for a stop and renewing the worker's sign of life."""
_SILENT_REDIS_S = 415
"""Seconds without an answer on an open Redis connection before the process exits and is replaced. RQ's own value."""
_LONGEST_JOB_S = 86_400
"""Seconds that `rq info` lists a worker during one job: RQ's heartbeat is only renewed after the job."""


class InProcessWorker(BaseWorker):  # type: ignore[misc]
    """A worker for one queue that runs one job at a time in this process, which keeps the model in memory.

    Parameters
    ----------
    queue : str
        Name of the RQ queue.
    connection : Redis
    run : callable
        Runs the next job of the record; receives the id of the job for which the message was sent.
    on_idle : callable
        Called before each wait for a message, every ten seconds while there is none.
    on_stop : callable
        Called once, from the signal handler of SIGINT and SIGTERM. It must not block or take a lock: signals come in
        bursts, and one handler interrupts another. (When a supervisor dies, the kernel sends one signal for each of
        its threads that ends after the main thread.)
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
        self._idle_at = 0.0
        super().__init__(
            [Queue(queue, connection=connection, serializer=JSONSerializer)],
            connection=connection,
            serializer=JSONSerializer,
        )

    def execute_job(self, job: Job, queue: Queue) -> None:
        """Delete the message; if it is ours, run the next job of the record."""
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
        except Exception:
            _log.exception("message %s", message)

    def run_maintenance_tasks(self) -> None:
        """Remove dead workers from RQ's list. Unlike RQ's method, do not clean registries, which calls callbacks."""
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
        """Renew this worker's entry in RQ, and stop if requested. RQ calls this before each wait.

        A library that catches every exception may have swallowed the one raised by `request_stop`.
        """
        if self.get_state() == WorkerStatus.IDLE:
            if self._ending:
                raise StopRequested
            if time.monotonic() >= self._idle_at:
                self._idle_at = time.monotonic() + _WAIT_S / 2
                self._on_idle()
        super().heartbeat(*args, **kwargs)

    def end_after_job(self) -> None:
        """Stop after the current job."""
        self._last = True


def _is_ours(job: Job) -> bool:
    try:
        return bool(job.func_name == MESSAGE)
    except Exception:  # whatever the serializer raises for bytes that it cannot read
        return False
