"""Checkpoints of a job in the object store: uploaded, read back, and only then pointed at."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator

from meshdeform.errors import CheckpointError, NotFoundError
from meshdeform.jobs.models import Job
from meshdeform.jobs.record import JobRecord
from meshdeform.storage import ObjectStore

__all__ = ["CheckpointStore"]

_log = logging.getLogger(__name__)
_KEPT = 2
_CONTENT_TYPE = "application/octet-stream"


class CheckpointStore:
    """The checkpoints of one attempt at one job, and those that earlier attempts left.

    Parameters
    ----------
    record : JobRecord
    store : ObjectStore
    job : Job
        As claimed: its attempt is in the keys, so two attempts never write the same object.
    """

    def __init__(self, record: JobRecord, store: ObjectStore, job: Job) -> None:
        self._record, self._store, self._job = record, store, job

    def usable(self) -> Iterator[bytes]:
        """The stored checkpoints that are whole, newest first."""
        for reference in self._record.checkpoints(self._job.id):
            try:
                data = self._store.get(reference.key)
            except NotFoundError:
                _log.warning("job %s: the checkpoint of step %d is gone", self._job.id, reference.step)
                continue
            if hashlib.sha256(data).hexdigest() == reference.sha256:
                yield data
            else:
                _log.warning("job %s: the checkpoint of step %d is torn", self._job.id, reference.step)

    def save(self, step: int, data: bytes) -> None:
        """Store the state after `step` steps; the last two stay.

        Raises
        ------
        CheckpointError
            What the store gives back is not what was written.
        StaleAttemptError
            Another attempt has taken the job over.
        UnavailableError
            The store or the record does not answer.
        """
        key = f"jobs/{self._job.id}/{self._job.attempt}/checkpoint-{step:06d}"
        sha256 = hashlib.sha256(data).hexdigest()
        self._store.put(key, data, _CONTENT_TYPE)
        if hashlib.sha256(self._store.get(key)).hexdigest() != sha256:
            raise CheckpointError(f"The object store did not keep the checkpoint of step {step} as it was written.")
        self._record.set_checkpoint(self._job.id, self._job.attempt, key=key, step=step, sha256=sha256)
        for reference in self._record.checkpoints(self._job.id)[_KEPT:]:
            self._record.forget_checkpoint(self._job.id, self._job.attempt, reference.key)
            self._store.delete(reference.key)
