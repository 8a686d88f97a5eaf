"""RQ's worker loop for jobs that run in this very process, with the model in memory.

rq 2.12's `SimpleWorker` does most of it. Changed here: a job has no time limit, so no alarm is set; a heartbeat is sent
while a job runs, so that other workers do not take it for dead; and a signal touches no Redis connection that the
interrupted code may be in the middle of using.
"""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import TYPE_CHECKING, Any

from redis import Redis
from redis.exceptions import RedisError
from rq import Queue, SimpleWorker
from rq.serializers import JSONSerializer
from rq.timeouts import BaseDeathPenalty
from rq.worker import WorkerStatus
from rq.worker.base import StopRequested

if TYPE_CHECKING:
    from rq.job import Job

__all__ = ["InProcessWorker"]

_log = logging.getLogger(__name__)
_HEARTBEAT_EVERY_S = 30.0
_LOOK_EVERY_S = 10
"""How long it waits for a job before it looks whether it is to end: a signal just before the wait does not wake it."""
_SILENT_REDIS_S = 415
"""How long a Redis that keeps the connection may say nothing before the process ends and a new one starts. RQ's own."""


class _NoTimeLimit(BaseDeathPenalty):  # type: ignore[misc]
    """A job may take as long as it takes: its lease, not an alarm, tells whether its worker is alive."""

    def setup_death_penalty(self) -> None:
        """Set no alarm."""

    def cancel_death_penalty(self) -> None:
        """There is none."""


class InProcessWorker(SimpleWorker):  # type: ignore[misc]
    """One queue, one job at a time, one process.

    Parameters
    ----------
    queue : str
        Name of the RQ queue.
    connection : Redis
    on_stop : callable
        Called once, from the signal handler of SIGINT and SIGTERM. It must not block, nor take a lock: signals come in
        bursts, and one handler interrupts another. (At a supervisor's death the kernel sends one for each of its
        threads that dies after the main thread.)
    """

    death_penalty_class = _NoTimeLimit
    max_connection_wait_time = 5.0
    dequeue_timeout = _LOOK_EVERY_S
    connection_timeout = _SILENT_REDIS_S

    def __init__(self, queue: str, connection: Redis, on_stop: Callable[[], None]) -> None:
        self._on_stop, self._told = on_stop, False
        super().__init__(
            [Queue(queue, connection=connection, serializer=JSONSerializer)],
            connection=connection,
            serializer=JSONSerializer,
            default_result_ttl=0,
        )

    def execute_job(self, job: Job, queue: Queue) -> None:
        """Run the job here, with heartbeats from a thread."""
        ended = threading.Event()
        heart = threading.Thread(target=self._beat_until, args=(ended, job), name="rq heartbeat", daemon=True)
        heart.start()
        try:
            super().execute_job(job, queue)
        finally:
            ended.set()
            heart.join()

    def request_stop(self, signum: int, frame: FrameType | None) -> None:  # noqa: ARG002 - RQ's signature
        """End after the job, which is told to stop after its step; at once where there is none."""
        if self._told:
            return
        self._told = self._stop_requested = True
        self._on_stop()
        if self.get_state() != WorkerStatus.BUSY:
            raise StopRequested

    def heartbeat(self, *args: Any, **kwargs: Any) -> None:
        """Sent before each wait for a job, too: the place to notice a stop whose exception was swallowed."""
        if self._told and self.get_state() == WorkerStatus.IDLE:
            raise StopRequested
        super().heartbeat(*args, **kwargs)

    def end_after_job(self) -> None:
        """Take no other job."""
        self._stop_requested = True

    def _install_signal_handlers(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self.request_stop)

    def _beat_until(self, ended: threading.Event, job: Job) -> None:
        while not ended.wait(_HEARTBEAT_EVERY_S):
            try:
                self.maintain_heartbeats(job)
            except RedisError as error:
                _log.warning("no heartbeat to RQ: %s", error)

    def handle_exception(self, job: Job, *exc_info: Any) -> None:
        """Log it once; RQ's own record of it is not kept."""
        _log.error("job %s", job.id, exc_info=exc_info)
