"""The worker process: ``python -m worker.process``, started by the supervisor. It loads torch and the prior."""

from __future__ import annotations

import logging
import os
import signal
import sys
from collections.abc import Callable

from redis import Redis
from redis.exceptions import RedisError

from meshdeform.errors import MeshdeformError
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from meshdeform.support.logs import configure_logging
from meshdeform.support.telemetry import start_tracing, stop_tracing
from worker.context import WorkerContext
from worker.engine import Engine, torch_engine
from worker.pulse import OUT_OF_MEMORY, STOP_GRACE_S, WORKER_ID, Pulse, new_worker_id
from worker.rq_worker import InProcessWorker
from worker.runner import JobRunner

__all__ = ["main"]

_log = logging.getLogger(__name__)


def main(load_engine: Callable[[Settings], Engine] = torch_engine) -> int:
    """Run jobs until a signal stops the process.

    Parameters
    ----------
    load_engine : callable
        Returns the engine; tests replace it.

    Returns
    -------
    int
        The exit code: 0, or `OUT_OF_MEMORY` if the device needs a clean context.
    """
    settings = Settings()
    configure_logging(settings)
    start_tracing("worker")
    # Before RQ's loop starts, a signal ends the process at once: nothing has been claimed yet.
    pulse = Pulse.of_environment()
    engine = load_engine(settings)
    stopping = spent = False

    def stop() -> None:
        # This runs in a signal handler, which another signal may interrupt: it must not take a lock.
        nonlocal stopping
        stopping = True
        # If a step hangs and the supervisor is gone, only the kernel's alarm can end this process.
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(round(STOP_GRACE_S))

    def renew() -> None:
        nonlocal spent
        _log.warning("this process exits to free the device's memory")
        spent = True
        listener.end_after_job()

    worker = WorkerIdentity(os.environ.get(WORKER_ID) or new_worker_id(), settings.queue, engine.device)
    record = JobRecord(settings.resolved_database_url, connections=1)
    context = WorkerContext(
        settings=settings,
        record=record,
        store=ObjectStore(settings.resolved_storage_url),
        listen=JobQueue(settings.redis_url, settings.queue).listen_for_cancel,
        start=engine.start,
        load_prior=engine.load_prior,
        device=engine.device,
        stopping=lambda: stopping,
        worker=worker,
        renew=renew,
        pulse=pulse,
    )

    def idle() -> None:
        try:
            record.leases.idle(worker)
        except MeshdeformError as error:
            _log.warning("the record was not updated with this worker's sign of life: %s", error.detail)

    listener = InProcessWorker(
        settings.queue, Redis.from_url(settings.redis_url), JobRunner(context).run, on_idle=idle, on_stop=stop
    )
    _log.info("worker %d: device %s, queue %s", os.getpid(), engine.device, settings.queue)
    pulse.rest()
    try:
        listener.work(logging_level="WARNING")
    except RedisError:
        if not stopping and not spent:
            raise
        _log.warning("this worker could not deregister from Redis")
    finally:
        stop_tracing()
    return OUT_OF_MEMORY if spent and not stopping else 0


if __name__ == "__main__":
    sys.exit(main())
