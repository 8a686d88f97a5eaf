"""What keeps the promise that no accepted job is lost: the record is compared with the leases and with Redis."""

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
    """Takes back jobs whose worker is silent, tells Redis again about those that it lost, and removes what is over.

    Any number may run at once: every change is one that `JobRecord` guards, and what is told twice is claimed once.

    Parameters
    ----------
    record : JobRecord
    queue : JobQueue
    max_attempts : int
        Workers that a job may lose before it fails.
    lease_s : float
        What a lease lasts; one that ends much later than that from now was given by a clock that has been set back.
    store : ObjectStore, optional
        With it, objects that nobody can reach any more are removed.
    every_s : float
        Seconds between two looks, when it runs as a context manager. Default: 5, or a sixth of a shorter lease.
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
        self._told: list[str] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="reconciler", daemon=True)

    def run_once(self) -> list[str]:
        """Look once. A duty that fails does not keep the others from being done; the next look does what is left.

        Returns
        -------
        list of str
            The jobs that Redis was told about.
        """
        self._told = []
        for duty in (self._take_back, self._expire, self._tell, self._delete, self._remove):
            try:
                duty()
            except MeshdeformError as error:
                _log.warning("the reconciler waits: %s", error)
            except Exception:
                # Without this thread nobody takes back what a dead worker held: it must outlive any mistake.
                _log.exception("the reconciler met an error that it does not know")
        return self._told

    def _take_back(self) -> None:
        if cut := self._record.upkeep.shorten_leases(self._lease_s):
            _log.warning("%d leases were given by a clock that is ahead; they are cut", cut)
        for job_id in self._record.upkeep.reclaim_expired(self._max_attempts):
            _log.warning("job %s: its worker is silent; it is queued again", job_id)
            failpoint("reconciler.reclaimed")

    def _expire(self) -> None:
        for job_id in self._record.upkeep.expire_deadlines():
            _log.info("job %s: its deadline is over", job_id)
            # Its worker is refused with its next write; told now, it stops at once.
            self._queue.publish_cancel(job_id)

    def _tell(self) -> None:
        """See that Redis holds a message for every queued job.

        Workers take the most urgent job, whichever they are told of: so as long as there are as many messages as queued
        jobs, none is forgotten, and nothing needs to be compared one by one.
        """
        # Before the rest: what comes after this look is left to the next one.
        untold = self._record.upkeep.untold()
        if self._queue.length() < self._record.upkeep.queued_count():
            told = self._queue.told()
            for job_id in self._record.upkeep.queued_ids():
                if job_id not in told:
                    self._queue.enqueue(job_id)
                    self._told.append(job_id)
                    failpoint("reconciler.told")
        if untold:
            self._record.upkeep.told(untold)

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
