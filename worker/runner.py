"""One attempt at a job, from the claim to exactly one of: succeeded, failed, canceled, handed back, or lost."""

from __future__ import annotations

import logging
from contextlib import AbstractContextManager
from dataclasses import dataclass

from meshdeform.errors import MeshdeformError, NotFoundError, StaleAttemptError, UnavailableError
from meshdeform.record.models import Job, JobState
from meshdeform.support.failpoints import failpoint
from meshdeform.support.telemetry import bound, span
from worker.attempt import Attempt, Ended, Outcome
from worker.context import WorkerContext
from worker.outputs import Retry
from worker.watch import JobWatch

__all__ = ["JobRunner"]

_log = logging.getLogger(__name__)
_TERMINAL = {
    Outcome.SUCCEEDED: JobState.SUCCEEDED,
    Outcome.FAILED: JobState.FAILED,
    Outcome.CANCELED: JobState.CANCELED,
}


@dataclass(frozen=True)
class JobRunner:
    """Runs jobs, one at a time, for the lifetime of its process."""

    at: WorkerContext

    def run(self, job_id: str) -> None:
        """Run the next job, which need not be `job_id`: that is only the job for which the message was sent.

        Errors of the job are recorded and not raised. If the record or the store does not answer for too long, the job
        returns to the queue, or stays claimed until its lease expires if even that cannot be written.
        `UnavailableError`: the record does not answer, so nothing is claimed.
        """
        failpoint("worker.told")
        self.at.pulse.beat()
        try:
            job = self.at.record.leases.claim_next(self.at.worker.id, self.at.settings.lease_s)
            if job is None:
                _log.info("message for job %s, but no job is queued (a duplicate, or another worker has it)", job_id)
                return
            with bound(job_id=job.id, request_id=job.request_id or ""), _traced(job):
                if job.id != job_id:
                    _log.info("message for job %s; job %s comes first", job_id, job.id)
                self._claimed(job)
        finally:
            self.at.pulse.rest()

    def _claimed(self, job: Job) -> None:
        _log.info("job %s: attempt %d", job.id, job.attempt)
        failpoint("worker.claimed")
        try:
            ended = self._attempt(job)
            # The watch has ended, so that nothing is written after this.
            self._record(job, ended)
        except (StaleAttemptError, NotFoundError):
            _log.warning("job %s: attempt %d has lost its lease and stops", job.id, job.attempt)
        except UnavailableError as error:
            _log.error("job %s: attempt %d leaves the job to another one: %s", job.id, job.attempt, error.detail)
            self._leave(job)
        else:
            failpoint("worker.ended")
            _log.info("job %s: attempt %d %s", job.id, job.attempt, ended.outcome.name.lower())

    def _attempt(self, job: Job) -> Ended:
        at = self.at
        with JobWatch(at.record.leases, at.worker, job, lambda: at.listen(job.id), at.settings.lease_s) as watch:
            ended = Attempt(at, job, watch).run()
            if watch.lost:
                raise StaleAttemptError("The lease is lost.")
        return ended

    def _record(self, job: Job, ended: Ended) -> None:
        """Record how the attempt ended, with retries; the record refuses it if another attempt has the job by then."""
        retry = Retry(self._between, self.at.retry_for_s)
        record, about = self.at.record, f"job {job.id}: its end"
        if ended.outcome is Outcome.OUT_OF_MEMORY:
            attempts = self.at.settings.max_attempts
            try:
                retry.until_answered(about, lambda: record.leases.out_of_memory(job.id, job.attempt, attempts))
            finally:
                self.at.renew()
        elif ended.outcome is Outcome.HANDED_BACK:
            retry.until_answered(about, lambda: record.leases.release(job.id, job.attempt))
        else:
            state, error, results, step_s = _TERMINAL[ended.outcome], ended.error, ended.results, ended.step_s
            retry.until_answered(
                about,
                lambda: record.leases.finish(job.id, job.attempt, state, error, results=results, step_s=step_s),
            )

    def _between(self) -> None:
        self.at.pulse.beat()
        if self.at.stopping():
            raise UnavailableError("The worker is stopping.")

    def _leave(self, job: Job) -> None:
        try:
            self.at.record.leases.release(job.id, job.attempt)
        except MeshdeformError as error:
            _log.warning("job %s: stays claimed until its lease expires: %s", job.id, error.detail)


def _traced(job: Job) -> AbstractContextManager[None]:
    """Open a span in the trace of the request that created the job."""
    attributes: dict[str, str | int | float] = {
        "job.id": job.id,
        "job.kind": job.kind.value,
        "job.attempt": job.attempt,
    }
    return span("attempt", attributes, traceparent=job.traceparent)
