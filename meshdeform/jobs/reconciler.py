"""What keeps the promise that no accepted job is lost: the record is compared with the leases and with Redis."""

from __future__ import annotations

import logging
import threading
from types import TracebackType
from typing import Self

from meshdeform.errors import MeshdeformError
from meshdeform.jobs.cleanup import remove_unreachable
from meshdeform.jobs.queue import JobQueue
from meshdeform.jobs.record import JobRecord
from meshdeform.storage import ObjectStore

__all__ = ["RECONCILE_EVERY_S", "Reconciler"]

_log = logging.getLogger(__name__)
RECONCILE_EVERY_S = 5.0


class Reconciler:
    """Takes back jobs whose worker is silent, and tells Redis again about those that it lost.

    Any number may run at once: every change is one that `JobRecord` guards, and what is told twice is claimed once.

    Parameters
    ----------
    record : JobRecord
    queue : JobQueue
    max_attempts : int
        Workers that a job may lose before it fails.
    store : ObjectStore, optional
        With it, objects that nobody can reach any more are removed.
    every_s : float
        Seconds between two looks, when it runs as a context manager.
    """

    def __init__(
        self,
        record: JobRecord,
        queue: JobQueue,
        max_attempts: int,
        *,
        store: ObjectStore | None = None,
        every_s: float = RECONCILE_EVERY_S,
    ) -> None:
        self._record, self._queue, self._max_attempts = record, queue, max_attempts
        self._store, self._every_s = store, every_s
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="reconciler", daemon=True)

    def run_once(self) -> list[str]:
        """Look once.

        Returns
        -------
        list of str
            The ids that Redis was told about.

        Raises
        ------
        UnavailableError
            The record, Redis or the store does not answer; the next look does what is left.
        """
        for job_id in self._record.reclaim_expired(self._max_attempts):
            _log.warning("job %s: its worker is silent; it is queued again", job_id)
        queued = self._record.queued_ids()
        told = self._queue.told() if queued else set()
        missing = [job_id for job_id in queued if job_id not in told]
        for job_id in missing:
            self._queue.enqueue(job_id)
        if self._store is not None:
            remove_unreachable(self._record, self._store)
        return missing

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._done.is_set():
            try:
                self.run_once()
            except MeshdeformError as error:
                _log.warning("the reconciler waits: %s", error)
            except Exception:
                # Without this thread nobody takes back what a dead worker held: it must outlive any mistake.
                _log.exception("the reconciler met an error that it does not know")
            self._done.wait(self._every_s)
