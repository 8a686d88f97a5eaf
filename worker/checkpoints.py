"""Store the checkpoints and results of an attempt. Each is uploaded and read back before the record refers to it."""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Iterator

from meshdeform.errors import MeshdeformError, NotFoundError, UnavailableError
from meshdeform.record.models import Artifact, CheckpointRef, Job
from meshdeform.record.repository import JobRecord
from meshdeform.runs.base import ArtifactData, JobRun
from meshdeform.storage import ObjectStore
from meshdeform.support.failpoints import failpoint
from worker.retry import Retry

_CONTENT_TYPE = "application/octet-stream"
_PAUSE_S, _PAUSE_PER_S = 1.0, 2.0
"""After a failure: the minimum pause, and its length per second that the failure took, so that steps get most time."""
_log = logging.getLogger(__name__)


class CheckpointStore:
    """The checkpoints of one attempt at a job, the newest `kept` of them, and those left by earlier attempts.

    The attempt is part of the keys, so that two attempts never write the same object. `step` is the newest step stored
    by this attempt; 0 for none. `made_by`: the versions that compute what it stores.
    """

    def __init__(self, record: JobRecord, store: ObjectStore, job: Job, kept: int, made_by: str) -> None:
        self._record, self._store, self._job, self._kept = record, store, job, kept
        self._not_before = 0.0
        self._missed = False
        self.step = 0
        self.made_by = made_by

    def usable(self, retry: Retry) -> Iterator[tuple[bytes, str | None]]:
        """Yield the intact stored checkpoints, newest first, with the versions that computed them."""
        about = f"job {self._job.id}: the checkpoints"
        for reference in retry.until_answered(about, lambda: self._record.leases.checkpoints(self._job.id)):
            what = f"the checkpoint of step {reference.step}"
            data = self._intact(reference.key, reference.sha256, what, retry)
            if data is not None:
                yield data, reference.made_by

    def origin(self, retry: Retry) -> bytes | None:
        """Return the checkpoint of the job's origin; None if there is none or it is damaged."""
        origin = self._job.origin
        if origin is None or not origin.key:
            return None
        return self._intact(origin.key, origin.sha256, f"the checkpoint of job {origin.job_id}", retry)

    def _intact(self, key: str, sha256: str, what: str, retry: Retry) -> bytes | None:
        try:
            data = retry.until_answered(f"job {self._job.id}: {what}", lambda: self._store.get(key))
        except NotFoundError:
            _log.warning("job %s: %s is gone", self._job.id, what)
            return None
        if hashlib.sha256(data).hexdigest() != sha256:
            _log.warning("job %s: %s is damaged", self._job.id, what)
            return None
        return data

    def due(self, step: int, every: int) -> bool:
        """Return whether to store step `step`: because of the interval, or because an earlier one was not stored."""
        return (step % every == 0 or self._missed) and time.monotonic() >= self._not_before

    def try_to_save(self, run: JobRun, *, mesh: bool = True) -> bool:
        """Store the current state, and return whether it was stored; `StaleAttemptError`: another attempt has the job.

        If the store or the record does not answer, warn and retry after a later step.
        """
        began = time.monotonic()
        try:
            self.save(run, mesh=mesh)
        except UnavailableError as error:
            now = time.monotonic()
            self._missed, self._not_before = True, now + max(_PAUSE_S, _PAUSE_PER_S * (now - began))
            _log.warning("job %s: the checkpoint of step %d is not stored: %s", self._job.id, run.step, error.detail)
            return False
        self._missed = False
        return True

    def save(self, run: JobRun, *, mesh: bool = True) -> None:
        """Store the current state with the mesh of that step, and delete the oldest checkpoints."""
        job, step = self._job, run.step
        name = f"checkpoint-{step:06d}"
        stored = store_artifact(self._store, job, name, ArtifactData(run.checkpoint(), _CONTENT_TYPE))
        shape = self._save_mesh(run, name) if mesh else None
        failpoint("worker.checkpoint.stored")
        self._record.leases.set_checkpoint(
            job.id,
            job.attempt,
            key=stored.key,
            step=step,
            sha256=stored.sha256,
            size=stored.size,
            mesh=shape,
            made_by=self.made_by,
        )
        failpoint("worker.checkpoint.recorded")
        self.step = step
        self._forget(self._record.leases.checkpoints(job.id)[self._kept :])

    def _save_mesh(self, run: JobRun, name: str) -> Artifact | None:
        """Store the mesh for people to view; return None on failure, because a checkpoint does not need it."""
        try:
            mesh = run.snapshot()
        except Exception:
            _log.exception("job %s: the mesh of step %d was not stored", self._job.id, run.step)
            return None
        return store_artifact(self._store, self._job, f"{name}.glb", mesh)

    def _forget(self, references: list[CheckpointRef]) -> None:
        for reference in references:
            self._record.leases.forget_checkpoint(self._job.id, self._job.attempt, reference.key)
            try:
                for key in filter(None, (reference.key, reference.mesh_key)):
                    self._store.delete(key)
            except MeshdeformError as error:
                # Nothing refers to it any more; it is deleted with the job.
                _log.warning("job %s: an old checkpoint is not deleted yet: %s", self._job.id, error.detail)


def store_artifact(store: ObjectStore, job: Job, name: str, artifact: ArtifactData) -> Artifact:
    """Store one artifact under the job's attempt, so that no two attempts write the same object.

    `UnavailableError`: the store does not answer, or returns different bytes.
    """
    key = f"jobs/{job.id}/{job.attempt}/{name}"
    stored = store.put_verified(key, artifact.data, artifact.content_type)
    return Artifact(name=name, content_type=artifact.content_type, size=stored.size, sha256=stored.sha256, key=key)


def store_results(store: ObjectStore, job: Job, artifacts: dict[str, ArtifactData], retry: Retry) -> list[Artifact]:
    """Store all results of a job; `UnavailableError`: the store has not answered within the time limit of `retry`."""
    results = []
    for name, artifact in artifacts.items():
        results.append(
            retry.until_answered(
                f"job {job.id}: {name}",
                lambda n=name, a=artifact: store_artifact(store, job, n, a),  # type: ignore[misc]
            )
        )
        failpoint("worker.result.stored")
    return results
