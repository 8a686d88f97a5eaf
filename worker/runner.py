"""One attempt at a job, from the claim to exactly one of: succeeded, failed, canceled, handed back, or lost."""

from __future__ import annotations

import datetime as dt
import logging
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from enum import Enum, auto
from typing import Protocol

from meshdeform.config import GuidanceKind, JobRequest, resolve
from meshdeform.errors import CheckpointError, MeshdeformError, StaleAttemptError, UnavailableError
from meshdeform.gltf import Limits
from meshdeform.jobs.models import Artifact, Job, JobError, JobState
from meshdeform.jobs.record import JobRecord
from meshdeform.kinds.base import ArtifactData, JobRun
from meshdeform.priors.base import Prior
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from worker.checkpoints import CheckpointStore
from worker.progress import CancelListener, JobWatch

__all__ = ["JobRunner", "StartRun"]

_log = logging.getLogger(__name__)


class StartRun(Protocol):
    """How a kind of job starts: `meshdeform.kinds.text_deform.start`."""

    def __call__(
        self,
        *,
        asset: bytes,
        filename: str,
        request: JobRequest,
        prior: Prior | None,
        target: bytes | None,
        target_filename: str,
        checkpoint: bytes | None,
        default_model: str,
        limits: Limits | None,
        device: str,
    ) -> JobRun:
        """Read the asset and get ready to run."""


class _Outcome(Enum):
    FINISHED = auto()
    CANCELED = auto()
    HANDED_BACK = auto()


@dataclass(frozen=True)
class JobRunner:
    """Runs jobs, one at a time; lives as long as its process.

    Attributes
    ----------
    settings : Settings
    record, store : JobRecord, ObjectStore
    listen : callable
        Opens a listener for the cancel of a job.
    start : StartRun
    load_prior : callable
        Gives the prior of a model; keeps it between jobs.
    device : str
    stopping : callable
        True once this process shall end: the job is then handed back after its step.
    worker_id : str
        Who the leases of this process belong to: no other process, ever, has the same.
    """

    settings: Settings
    record: JobRecord
    store: ObjectStore
    listen: Callable[[str], AbstractContextManager[CancelListener]]
    start: StartRun
    load_prior: Callable[[str], Prior]
    device: str
    stopping: Callable[[], bool]
    worker_id: str

    def run(self, job_id: str) -> None:
        """Run the job if it is there to be claimed.

        Nothing is raised for what is wrong with the job: that is recorded. When the record or the store does not
        answer, the error is raised and the job keeps its lease; once that is over, another attempt takes it up.
        """
        job = self.record.claim(job_id, self.worker_id, self.settings.lease_s)
        if job is None:
            _log.info("job %s: not to be claimed (a duplicate delivery, or somebody else has it)", job_id)
            return
        _log.info("job %s: attempt %d", job.id, job.attempt)
        try:
            self._attempt(job)
        except StaleAttemptError:
            _log.warning("job %s: attempt %d has lost its lease and stops", job.id, job.attempt)
        except UnavailableError:
            _log.exception("job %s: attempt %d leaves the job to another one", job.id, job.attempt)
            raise

    def _attempt(self, job: Job) -> None:
        error: JobError | None = None
        outcome = _Outcome.FINISHED
        with JobWatch(self.record, job, lambda: self.listen(job.id), self.settings.lease_s) as watch:
            try:
                outcome = self._work(job, watch)
            except (StaleAttemptError, UnavailableError):
                raise
            except MeshdeformError as problem:
                _log.warning("job %s: failed: %s", job.id, problem)
                error = JobError.of(problem)
            except Exception:
                _log.exception("job %s: failed", job.id)
                # What an unforeseen error says may hold paths of this machine: it stays in the log.
                error = JobError.of(MeshdeformError("The worker met an error that it does not know; its log has it."))
            if watch.lost:
                raise StaleAttemptError("The lease is lost.")
        # The watch has ended: nothing can follow what is written now.
        if error is not None:
            self.record.finish(job.id, job.attempt, JobState.FAILED, error)
        elif outcome is _Outcome.CANCELED:
            self.record.finish(job.id, job.attempt, JobState.CANCELED)
        elif outcome is _Outcome.HANDED_BACK:
            self.record.release(job.id, job.attempt)
        else:
            self.record.finish(job.id, job.attempt, JobState.SUCCEEDED)
        _log.info("job %s: attempt %d %s", job.id, job.attempt, "failed" if error else outcome.name.lower())

    def _work(self, job: Job, watch: JobWatch) -> _Outcome:
        checkpoints = CheckpointStore(self.record, self.store, job)
        if self._must_stop(watch):
            return self._stop(watch)
        run = self._start(job, checkpoints.usable())
        watch.phase("optimizing", step=run.step, total_steps=run.total_steps)
        if self._must_stop(watch):
            return self._stop(watch)
        every = job.request.params.checkpoint_every_steps
        for report in run:
            watch.step(report)
            stop = self._must_stop(watch)
            due = report.step % every == 0 and report.step < report.total_steps
            # A canceled job needs no checkpoint; one that is handed back needs it most of all.
            if (due or stop) and not watch.canceled:
                checkpoints.save(report.step, run.checkpoint())
            if stop:
                return self._stop(watch)
        watch.phase("writing")
        artifacts = run.finish()
        if watch.canceled:
            return _Outcome.CANCELED
        watch.phase("uploading")
        self._publish(job, artifacts)
        return _Outcome.CANCELED if watch.canceled else _Outcome.FINISHED

    def _must_stop(self, watch: JobWatch) -> bool:
        if watch.lost:
            raise StaleAttemptError("The lease is lost.")
        return watch.canceled or self.stopping()

    def _stop(self, watch: JobWatch) -> _Outcome:
        return _Outcome.CANCELED if watch.canceled else _Outcome.HANDED_BACK

    def _start(self, job: Job, checkpoints: Iterable[bytes]) -> JobRun:
        """Start from the newest checkpoint that can be used, else from the beginning."""
        asset = self.store.get(job.asset.key)
        target = self.store.get(job.target.key) if job.target else None
        params = resolve(job.request.params, default_model=self.settings.model)
        prior = self.load_prior(params.model) if params.guidance is GuidanceKind.SDS else None

        def start(checkpoint: bytes | None) -> JobRun:
            return self.start(
                asset=asset,
                filename=job.asset.filename,
                request=job.request,
                prior=prior,
                target=target,
                target_filename=job.target.filename if job.target else "",
                checkpoint=checkpoint,
                default_model=self.settings.model,
                limits=Limits.from_settings(self.settings),
                device=self.device,
            )

        for checkpoint in checkpoints:
            try:
                run = start(checkpoint)
            except CheckpointError as error:
                _log.warning("job %s: %s", job.id, error)
                continue
            _log.info("job %s: goes on from step %d", job.id, run.step)
            return run
        return start(None)

    def _publish(self, job: Job, artifacts: dict[str, ArtifactData]) -> None:
        for name, artifact in artifacts.items():
            key = f"jobs/{job.id}/{job.attempt}/{name}"
            stored = self.store.put(key, artifact.data, artifact.content_type)
            self.record.add_artifact(
                job.id,
                job.attempt,
                Artifact(
                    name=name,
                    content_type=artifact.content_type,
                    size=stored.size,
                    sha256=stored.sha256,
                    key=key,
                    created_at=dt.datetime.now(dt.UTC),
                ),
            )
