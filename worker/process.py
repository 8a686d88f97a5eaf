"""The worker process: ``python -m worker.process``, started by the supervisor. It holds torch and the prior."""

from __future__ import annotations

import logging
import os
import signal

from redis import Redis

from meshdeform.devices import use_threads
from meshdeform.settings import Settings
from worker import tasks
from worker.rq_worker import InProcessWorker
from worker.supervisor import STOP_GRACE_S, configure_logging

__all__ = ["main"]

_log = logging.getLogger(__name__)


def main() -> None:
    """Take jobs until a signal says to stop."""
    configure_logging()
    # A signal before RQ's loop begins ends the process at once, which is right: nothing has been claimed yet.
    settings = Settings()
    threads = use_threads(settings.threads)
    runner = tasks.runner()
    _log.info("worker %d: %d threads, device %s, queue %s", os.getpid(), threads, runner.device, settings.queue)
    connection = Redis.from_url(settings.redis_url)
    InProcessWorker(settings.queue, connection, _stop).work(logging_level="WARNING")


def _stop() -> None:
    tasks.stopping.set()
    # Should a step hang and the supervisor be gone, nobody else would end this process: the kernel's alarm does, and
    # it needs no thread, which a signal handler cannot start safely.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(round(STOP_GRACE_S))


if __name__ == "__main__":
    main()
