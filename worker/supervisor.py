"""Keeps one worker process running, and the queue in step with the record. Never imports torch.

It stays up when its worker dies of a crash, of the out-of-memory killer or of a signal, and starts it again with
back-off. It also runs the reconciler, which takes jobs back from workers that are gone.
"""

from __future__ import annotations

import logging
import signal
import sys

from meshdeform.errors import MeshdeformError
from meshdeform.jobs.queue import JobQueue
from meshdeform.jobs.reconciler import Reconciler
from meshdeform.jobs.record import JobRecord
from meshdeform.processes import Child, KeptChild, SignalInbox, python_command
from meshdeform.settings import Settings
from worker.identity import WORKER_ID, new_worker_id

__all__ = ["STOP_GRACE_S", "Supervisor", "configure_logging"]

_log = logging.getLogger(__name__)

STOP_GRACE_S = 30.0
"""What a worker gets after SIGTERM to finish its step and write a checkpoint."""

_TEND_EVERY_S = 0.25


def configure_logging() -> None:
    """One line per event on standard error, the same in supervisor and worker."""
    logging.basicConfig(
        level=logging.INFO, format="%(asctime)s %(levelname)-7s %(message)s", datefmt="%H:%M:%S", stream=sys.stderr
    )
    logging.getLogger("alembic").setLevel(logging.WARNING)


class Supervisor:
    """One worker and the reconciler.

    Parameters
    ----------
    settings : Settings
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._worker_id = ""

    def run(self) -> None:
        """Tend the worker until SIGINT or SIGTERM, then let it hand its job back and end.

        Raises
        ------
        UnavailableError
            The record cannot be opened.
        """
        with SignalInbox(signal.SIGINT, signal.SIGTERM, signal.SIGCHLD) as inbox:
            record = JobRecord(self._settings.resolved_database_url)
            queue = JobQueue(self._settings.redis_url, self._settings.queue)
            with Reconciler(record, queue, max_attempts=self._settings.max_attempts):
                worker = KeptChild(self._start_worker, _log.warning, lambda: self._give_up_lease(record))
                while not inbox.wait(_TEND_EVERY_S) & {signal.SIGINT, signal.SIGTERM}:
                    worker.tend()
                worker.stop(STOP_GRACE_S)
            queue.close()
            record.close()

    def _start_worker(self) -> Child:
        # Read by the libraries below torch and numba when they are loaded, so before the process starts.
        threads = str(self._settings.threads)
        limits = {"OMP_NUM_THREADS": threads, "NUMBA_NUM_THREADS": threads} if self._settings.threads else {}
        self._worker_id = new_worker_id()
        environment = {**limits, WORKER_ID: self._worker_id}
        return Child("worker process", python_command("worker.process"), env=environment)

    def _give_up_lease(self, record: JobRecord) -> None:
        """Let the job of the worker that just died be taken back now, not when its lease is over."""
        try:
            if record.worker_ended(self._worker_id):
                _log.warning("the worker process held a job; it is taken back")
        except MeshdeformError as error:
            _log.warning("the job of the worker process waits for the end of its lease: %s", error)
