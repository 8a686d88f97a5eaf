"""RQ's worker loop, as a doorbell: a message says that a job waits, and the record says which.

A message is deleted as soon as it is read, before the job starts: RQ then has nothing to time, to retry or to clean up,
and keeps no result. Should the worker die with it, the reconciler sends another one. Only public methods of RQ's worker
are used and overridden.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

from redis import Redis
from rq import Queue
from rq.job import Job
from rq.serializers import JSONSerializer
from rq.worker import WorkerStatus
from rq.worker.base import BaseWorker, StopRequested

from meshdeform.record.queue import job_of

__all__ = ["InProcessWorker"]

_log = logging.getLogger(__name__)
_LOOK_EVERY_S = 10
"""How long it waits for a message before it looks whether it is to end, and says that it is alive."""
_SILENT_REDIS_S = 415
"""How long a Redis that keeps the connection may say nothing before the process ends and a new one starts. RQ's own."""
_LONGEST_JOB_S = 86_400
"""How long `rq info` shows a worker that runs one job: it hears of it again when the job is over."""


class InProcessWorker(BaseWorker):  # type: ignore[misc]
    """One queue, one job at a time, in this process, which keeps the model in memory.

    Parameters
    ----------
    queue : str
        Name of the RQ queue.
    connection : Redis
    run : callable
        Runs the most urgent job of the record; gets the id of the job that the message was sent for.
    on_idle : callable
        Called before each wait for a message, every ten seconds while none comes.
    on_stop : callable
        Called once, from the signal handler of SIGINT and SIGTERM. It must not block, nor take a lock: signals come in
        bursts, and one handler interrupts another. (At a supervisor's death the kernel sends one for each of its
        threads that dies after the main thread.)
    """

    max_connection_wait_time = 5.0
    dequeue_timeout = _LOOK_EVERY_S
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
        self._told = self._last = False
        self._idle_at = 0.0
        super().__init__(
            [Queue(queue, connection=connection, serializer=JSONSerializer)],
            connection=connection,
            serializer=JSONSerializer,
        )

    def execute_job(self, job: Job, queue: Queue) -> None:
        """Delete the message, then run what the record says."""
        self.set_state(WorkerStatus.BUSY)
        self.heartbeat(_LONGEST_JOB_S)
        job.delete()
        self.connection.lrem(queue.intermediate_queue_key, 1, job.id)
        try:
            self._run(job_of(job.id))
        except Exception:
            _log.exception("message %s", job.id)
        if self._told or self._last:
            raise StopRequested

    def request_stop(self, signum: int, frame: FrameType | None) -> None:  # noqa: ARG002 - RQ's signature
        """End after the job, which is told to stop after its step; at once where there is none.

        Unlike RQ's own, this touches no Redis connection, which the interrupted code may be in the middle of using.
        """
        if self._told:
            return
        self._told = True
        self._on_stop()
        if self.get_state() != WorkerStatus.BUSY:
            raise StopRequested

    def heartbeat(self, *args: Any, **kwargs: Any) -> None:
        """Tell RQ that this worker lives. RQ does so before each wait: the place to notice a stop, too.

        The exception of `request_stop` may have been swallowed by a library that catches every one.
        """
        if self.get_state() == WorkerStatus.IDLE:
            if self._told:
                raise StopRequested
            if time.monotonic() >= self._idle_at:
                self._idle_at = time.monotonic() + _LOOK_EVERY_S / 2
                self._on_idle()
        super().heartbeat(*args, **kwargs)

    def end_after_job(self) -> None:
        """Take no other job."""
        self._last = True
