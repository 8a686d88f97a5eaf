"""What RQ calls by name: ``worker.tasks.run_job(job_id)``. Redis holds nothing but the id."""

from __future__ import annotations

import functools
import os
import threading

from meshdeform.devices import resolve_device
from meshdeform.jobs.queue import JobQueue
from meshdeform.jobs.record import JobRecord
from meshdeform.kinds import text_deform
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from worker.identity import WORKER_ID, new_worker_id
from worker.priors import PriorCache
from worker.runner import JobRunner

__all__ = ["run_job", "runner", "stopping"]

stopping = threading.Event()
"""Set once this process shall end. Only ever polled by the main thread, so a signal handler may set it."""


@functools.cache
def runner() -> JobRunner:
    """The runner of this process, made from the environment on first use and kept, with its prior, between jobs."""
    settings = Settings()
    device = resolve_device(settings.device)
    queue = JobQueue(settings.redis_url, settings.queue)
    priors = PriorCache()
    return JobRunner(
        settings=settings,
        record=JobRecord(settings.resolved_database_url),
        store=ObjectStore(settings.resolved_storage_url),
        listen=queue.listen_for_cancel,
        start=text_deform.start,
        load_prior=lambda model: priors.get(
            model, device=device, revision=settings.model_revision if model == settings.model else ""
        ),
        device=device,
        stopping=stopping.is_set,
        worker_id=os.environ.get(WORKER_ID) or new_worker_id(),
    )


def run_job(job_id: str) -> None:
    """Run one job; see `worker.runner.JobRunner.run`."""
    runner().run(job_id)
