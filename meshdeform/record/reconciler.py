"""Compare the record with leases and Redis, and repair differences, so that no accepted job is lost."""

from __future__ import annotations

import logging
import threading
from types import TracebackType
from typing import Self

from meshdeform.errors import MeshdeformError
from meshdeform.record.cleanup import remove_unreachable
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.storage import ObjectStore
from meshdeform.support.failpoints import failpoint

__all__ = ["RECONCILE_EVERY_S", "Reconciler"]

_log = logging.getLogger(__name__)
RECONCILE_EVERY_S = 5.0


class Reconciler:
    """A periodic task that takes back jobs of silent workers, repeats lost messages, and removes expired data.

    Any number may run at once: every change is guarded by the state that it starts from, and a job announced twice is
    claimed once.

    Parameters
    ----------
    record : JobRecord
    queue : JobQueue
    max_attempts : int
        Number of lost workers after which a job fails.
    lease_s : float
        Duration of a lease. A lease that ends much later was given before the clock was set back, and is shortened.
    store : ObjectStore, optional
        If given, unreachable objects are removed from it.
    every_s : float
        Seconds between two runs as a context manager. Default: 5, or a sixth of a shorter lease.
    """

    def __init__(
        self,
        record: JobRecord,
        queue: JobQueue,
        max_attempts: int,
        lease_s: float,
        *,
        store: ObjectStore | None = None,
        every_s: float | None = None,
    ) -> None:
        self._record, self._queue, self._max_attempts, self._lease_s = record, queue, max_attempts, lease_s
        self._store = store
        self._every_s = min(RECONCILE_EVERY_S, lease_s / 6) if every_s is None else every_s
        self._announced: list[str] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="reconciler", daemon=True)

    def run_once(self) -> list[str]:
        """Run all tasks once. If one fails, the others still run, and the next run does the rest.

        Returns
        -------
        list of str
            The jobs announced to Redis.
        """
        self._announced = []
        for duty in (self._take_back, self._expire, self._announce, self._delete, self._remove):
            try:
                duty()
            except MeshdeformError as error:
                _log.warning("the reconciler will retry: %s", error)
            except Exception:
                # Without this thread no jobs are taken back from dead workers: it must survive any error.
                _log.exception("unexpected error in the reconciler")
        return self._announced

    def _take_back(self) -> None:
        if cut := self._record.upkeep.shorten_leases(self._lease_s):
            _log.warning("%d leases were given before the clock was set back; they are shortened", cut)
        for job_id in self._record.upkeep.reclaim_expired(self._max_attempts):
            _log.warning("job %s: its worker is silent; it is queued again", job_id)
            failpoint("reconciler.reclaimed")

    def _expire(self) -> None:
        for job_id in self._record.upkeep.expire_deadlines():
            _log.info("job %s: its deadline has passed", job_id)
            # The worker's next write is refused; with this message it stops at once.
            self._queue.publish_cancel(job_id)

    def _announce(self) -> None:
        """Ensure that Redis has a message for every queued job.

        Workers claim the next job, whichever message they read. So as long as there are as many messages as queued
        jobs, none is forgotten, and they need not be compared one by one.
        """
        # Read first: jobs queued after this are left to the next run.
        unannounced = self._record.upkeep.unannounced()
        if self._queue.length() < self._record.upkeep.queued_count():
            announced = self._queue.announced()
            for job_id in self._record.upkeep.queued_ids():
                if job_id not in announced:
                    self._queue.enqueue(job_id)
                    self._announced.append(job_id)
                    failpoint("reconciler.told")
        if unannounced:
            self._record.upkeep.mark_announced(unannounced)

    def _delete(self) -> None:
        if deleted := self._record.upkeep.delete_retained():
            _log.info("%d jobs are past their retention and deleted", len(deleted))
        self._record.upkeep.delete_stale_requests()

    def _remove(self) -> None:
        if self._store is not None:
            remove_unreachable(self._record, self._store)

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
            self.run_once()
            self._done.wait(self._every_s)
