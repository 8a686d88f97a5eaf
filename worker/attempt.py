"""Run one attempt at a job, from the claim to exactly one of: succeeded, failed, canceled, handed back, or lost."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import partial
from typing import TYPE_CHECKING

from meshdeform.assets import Limits
from meshdeform.errors import (
    CheckpointError,
    DependencyError,
    MeshdeformError,
    ModelError,
    NotFoundError,
    StaleAttemptError,
    UnavailableError,
)
from meshdeform.record.leases import HANDED_BACK, HANDED_OVER, OUTAGE, WorkerIdentity
from meshdeform.record.models import Artifact, Job, JobError, JobState, OriginMode, StoredFile
from meshdeform.record.repository import JobRecord
from meshdeform.record.turns import Turns
from meshdeform.runs.base import ArtifactData, InputFile, JobRun, RunInput, StartRun
from meshdeform.runs.costs import END_SHARE, costs_of
from meshdeform.runs.kept_readings import FolderReadings, Several
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from meshdeform.storage.readings import StoredReadings
from meshdeform.support.failpoints import failpoint
from meshdeform.support.sources import build
from meshdeform.support.telemetry import bound, span
from worker.checkpoints import CheckpointStore, store_results
from worker.health import Pulse
from worker.overdue import OPTIMIZING, over_time, time_limit
from worker.retry import RETRY_FOR_S, Retry
from worker.watch import CancelListener, JobWatch

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

_log = logging.getLogger(__name__)

_OUT_OF_MEMORY = "OutOfMemoryError"
# Messages of CUDA and its libraries for which torch has no exception class.
_OUT_OF_MEMORY_WORDS = ("CUDA error: out of memory", "CUBLAS_STATUS_ALLOC_FAILED", "CUDNN_STATUS_ALLOC_FAILED")


@dataclass(frozen=True)
class WorkerContext:
    """The settings, the record, the store, and the functions that start a run."""

    settings: Settings
    record: JobRecord
    store: ObjectStore
    listen: Callable[[str], AbstractContextManager[CancelListener]]  # opens a listener for the cancellation of a job
    start: StartRun  # starts a run of any kind: `meshdeform.runs.start_run`, which imports the kind's dependencies
    load_prior: Callable[[str], Prior]  # returns the prior of a model and keeps it between jobs
    device: str
    stopping: Callable[[], bool]
    """Returns True once this process is stopping: the job is then handed back after its current step."""
    worker: WorkerIdentity  # the holder of this process's leases
    renew: Callable[[], None]
    """Ends this process after the job because its device ran out of memory; its successor has a clean context."""
    pulse: Pulse = field(default_factory=Pulse)  # shows the supervisor that the worker makes progress
    retry_for_s: float = RETRY_FOR_S
    """Maximum seconds of an outage of the store or the record before the job is left to another attempt."""


class AttemptOutcome(Enum):
    """How an attempt ended."""

    SUCCEEDED = auto()
    FAILED = auto()
    CANCELED = auto()
    HANDED_BACK = auto()
    HANDED_OVER = auto()
    OUT_OF_MEMORY = auto()


_TERMINAL = {
    AttemptOutcome.SUCCEEDED: JobState.SUCCEEDED,
    AttemptOutcome.FAILED: JobState.FAILED,
    AttemptOutcome.CANCELED: JobState.CANCELED,
}


@dataclass(frozen=True)
class Ended:
    """The end of an attempt, not yet recorded: its stored results, or why it failed.

    `step_s` are the mean seconds per step; None if no step was done. `may_pass`: another attempt may not fail so.
    `made_by` are the versions that computed the results.
    """

    outcome: AttemptOutcome
    results: list[Artifact] = field(default_factory=list)
    error: JobError | None = None
    step_s: float | None = None
    may_pass: bool = False
    made_by: str | None = None


class _InterruptedError(Exception):
    """The job was canceled, makes room for another one, or the process is stopping, during a wait."""


class Attempt:
    """One attempt at a claimed job, under a running watch."""

    def __init__(self, context: WorkerContext, job: Job, watch: JobWatch) -> None:
        self._context, self._job, self._watch = context, job, watch
        self._retry = Retry(self._go_on, context.retry_for_s)
        self._made_by = build()
        self._checkpoints = CheckpointStore(
            context.record, context.store, job, context.settings.checkpoints_kept, self._made_by
        )
        self._run: JobRun | None = None
        self._steps, self._steps_s = 0, 0.0
        self._max_run_s = time_limit(job.document, context.settings.max_run_s)
        self._ends = time.monotonic() + self._max_run_s - job.ran_s

    def run(self) -> Ended:
        """Run the attempt and return how it ended."""
        try:
            return self._work()
        except _InterruptedError:
            return self._stopped()
        except (StaleAttemptError, UnavailableError):
            raise
        except Exception as error:
            if is_out_of_memory(error):
                return self._out_of_memory(error)
            return self._failed(error)

    def _work(self) -> Ended:
        if self._must_stop():
            return self._stopped()
        with span("start"):
            run = self._run = self._start()
        failpoint("worker.started")
        self._phase(OPTIMIZING, run)
        if self._must_stop():
            return self._stopped()
        with span("optimize"):
            stopped = self._optimize(run)
        if stopped is not None:
            return self._ended(stopped)
        self._phase("writing")
        artifacts = with_versions(run.finish(), self._made_by)
        failpoint("worker.finished")
        if self._watch.canceled:
            return self._ended(AttemptOutcome.CANCELED)
        self._phase("uploading")
        with span("upload"):
            results = store_results(self._context.store, self._job, artifacts, self._retry)
        failpoint("worker.results.stored")
        if self._watch.canceled:
            return self._ended(AttemptOutcome.CANCELED)
        return self._ended(AttemptOutcome.SUCCEEDED, results=results)

    def _optimize(self, run: JobRun) -> AttemptOutcome | None:
        """Do the remaining steps; return how the attempt ends if it must stop before the job's end."""
        every = self._job.request.params.checkpoint_every_steps
        began = time.monotonic()
        for report in run:
            self._steps, self._steps_s = self._steps + 1, self._steps_s + time.monotonic() - began
            self._context.pulse.beat()
            self._watch.step(report)
            failpoint("worker.step")
            stop, more = self._must_stop(), report.step < report.total_steps
            over, yields = more and time.monotonic() >= self._ends, more and self._watch.yields
            due = more and self._checkpoints.due(report.step, 1 if yields else every)
            # A canceled job needs no checkpoint; a job that is handed back does.
            saved = (due or stop or over) and not self._watch.canceled and self._checkpoints.try_to_save(run)
            if stop:
                return self._interrupted()
            if over:
                raise over_time(self._max_run_s, f"done {report.step} of {report.total_steps} steps")
            if yields and saved:
                return AttemptOutcome.HANDED_OVER
            began = time.monotonic()
        return None

    def _start(self) -> JobRun:
        """Start from the newest usable checkpoint, otherwise from the job's origin or its files."""
        job = self._job
        files = {name: self._input(name, file) for name, file in job.files.items()}

        def load_prior(model: str) -> Prior:
            self._go_on()
            prior = self._context.load_prior(model)
            self._go_on()
            return prior

        def start(checkpoint: bytes | None = None, initial: bytes | None = None) -> JobRun:
            self._go_on()
            job_input = RunInput(
                request=job.request,
                files=files,
                resolved=job.resolved,
                checkpoint=checkpoint,
                initial=initial,
                load_prior=load_prior,
                default_model=self._context.settings.model,
                limits=Limits.from_settings(self._context.settings),
                device=self._context.device,
                readings=Several(
                    FolderReadings(self._context.settings.cache_folder), StoredReadings(self._context.store)
                ),
                on_wait=self._go_on,
            )
            return self._context.start(job_input)

        for checkpoint, made_by in self._checkpoints.usable(self._retry):
            try:
                run = start(checkpoint)
            except CheckpointError as error:
                _log.warning("job %s: %s", job.id, error)
                continue
            self._continues(made_by)
            _log.info("job %s: resumes at step %d", job.id, run.step)
            return run
        if job.origin is None or not job.origin.key:
            return start()
        origin = self._checkpoints.origin(self._retry)
        if job.origin.mode is OriginMode.BRANCH:
            if origin is None:
                raise CheckpointError(f"The checkpoint of job {job.origin.job_id} can no longer be read.")
            return start(initial=origin)
        try:
            run = start(origin)
        except CheckpointError as error:
            # The request is the same, so a start from the beginning gives the same result.
            _log.warning("job %s: starts from the beginning: %s", job.id, error)
            return start()
        if origin is not None:
            self._continues(job.origin.made_by)
        return run

    def _continues(self, made_by: str | None) -> None:
        """Note which versions have computed what the attempt goes on from."""
        before = [each for each in (made_by or "").split(", ") if each]
        self._made_by = self._checkpoints.made_by = ", ".join(dict.fromkeys([*before, build()]))

    def _input(self, name: str, file: StoredFile) -> InputFile:
        """Read a file of the job and verify its SHA-256."""
        what = f"job {self._job.id}: the file {name}"
        data = self._retry.until_answered(what, lambda: self._context.store.get(file.key, sha256=file.sha256))
        return InputFile(data, file.filename, file.sha256)

    def _phase(self, name: str, run: JobRun | None = None) -> None:
        self._context.pulse.beat()
        if self._watch.canceled:
            raise _InterruptedError
        if run is None:
            self._watch.phase(name)
        else:
            self._watch.phase(name, step=run.step, total_steps=run.total_steps)

    def _must_stop(self) -> bool:
        if self._watch.lost:
            raise StaleAttemptError("The lease is lost.")
        return self._watch.canceled or self._context.stopping()

    def _go_on(self) -> None:
        self._context.pulse.beat()
        if self._must_stop() or self._watch.yields:
            raise _InterruptedError
        if time.monotonic() >= self._ends:
            raise over_time(self._max_run_s, f"was {self._watch.doing}")

    def _interrupted(self) -> AttemptOutcome:
        if self._watch.canceled:
            return AttemptOutcome.CANCELED
        return AttemptOutcome.HANDED_BACK if self._context.stopping() else AttemptOutcome.HANDED_OVER

    def _stopped(self) -> Ended:
        return self._ended(self._interrupted())

    def _failed(self, error: Exception) -> Ended:
        if isinstance(error, MeshdeformError):
            _log.warning("job %s: failed: %s", self._job.id, error)
            return self._ended(AttemptOutcome.FAILED, error=JobError.of(error), may_pass=self._may_pass(error))
        _log.error("job %s: failed", self._job.id, exc_info=error)
        # The text of an unexpected error may contain paths of this machine, so it stays in the log.
        unknown = MeshdeformError("An unexpected error occurred in the worker; see the worker's log.")
        return self._ended(AttemptOutcome.FAILED, error=JobError.of(unknown), may_pass=True)

    def _may_pass(self, error: MeshdeformError) -> bool:
        """Return whether another attempt may not fail so: another worker may have what this one lacks."""
        if not isinstance(error, DependencyError | ModelError):
            return error.transient
        leases = self._context.record.leases
        others = self._retry.until_answered("the other workers", lambda: leases.alive(self._context.worker.queue)) > 1
        if others:
            leases.leave_to_others(self._job.id)
        return others

    def _out_of_memory(self, error: Exception) -> Ended:
        """Save the state from before the step that ran out of memory, if possible."""
        _log.warning("job %s: the device is out of memory: %s", self._job.id, error)
        run = self._run
        if run is not None and run.step > self._checkpoints.step and not self._watch.canceled:
            try:
                self._checkpoints.try_to_save(run, mesh=False)
            except StaleAttemptError:
                raise
            except Exception:
                _log.exception("job %s: the checkpoint of step %d was not stored", self._job.id, run.step)
        return self._ended(AttemptOutcome.OUT_OF_MEMORY)

    def _ended(
        self,
        outcome: AttemptOutcome,
        *,
        results: list[Artifact] | None = None,
        error: JobError | None = None,
        may_pass: bool = False,
    ) -> Ended:
        step_s = self._steps_s / self._steps if self._steps else None
        return Ended(outcome, results or [], error, step_s, may_pass, self._made_by if results else None)


@dataclass(frozen=True)
class JobRunner:
    """Runs jobs, one at a time, for the lifetime of its process."""

    context: WorkerContext

    def run(self, job_id: str) -> None:
        """Run the next job, which need not be `job_id`: that is the job for which a message was sent, if there was one.

        Errors of the job are recorded and not raised. If the record or the store does not answer for too long, the job
        returns to the queue, or stays claimed until its lease expires if even that cannot be written.
        `UnavailableError`: the record does not answer, so nothing is claimed.
        """
        failpoint("worker.told")
        self.context.pulse.beat()
        try:
            # The job that may start now that this one has stopped may have no message left.
            while self._run_one(job_id):
                job_id = ""
        finally:
            self.context.pulse.rest()

    def _run_one(self, job_id: str) -> bool:
        """Run the next job, and return whether to look for another one at once."""
        job = self.context.record.leases.claim_next(self.context.worker.id, self.context.settings.lease_s, self._turns)
        if job is None:
            if job_id:
                _log.info("message for job %s, but none is queued (a duplicate, or another worker has it)", job_id)
            return False
        with bound(job_id=job.id, request_id=job.request_id or ""), _traced(job):
            if job_id and job.id != job_id:
                _log.info("message for job %s; job %s comes first", job_id, job.id)
            outcome = self._claimed(job)
        limited = self._turns.max_running and outcome is not AttemptOutcome.OUT_OF_MEMORY
        return bool(limited or outcome is AttemptOutcome.HANDED_OVER) and not self.context.stopping()

    @property
    def _turns(self) -> Turns:
        return Turns.of(self.context.settings)

    def _claimed(self, job: Job) -> AttemptOutcome | None:
        """Run an attempt and record its end; return None if another one has the job, or will."""
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
            return ended.outcome
        return None

    def _attempt(self, job: Job) -> Ended:
        context, leases = self.context, self.context.record.leases
        end_s = END_SHARE * costs_of(job.request.workload).seconds(job.faces, job.meshes, None).once
        listen = partial(context.listen, job.id)
        with JobWatch(leases, context.worker, job, listen, context.settings.lease_s, self._turns, end_s) as watch:
            ended = Attempt(context, job, watch).run()
            if watch.lost:
                raise StaleAttemptError("The lease is lost.")
        return ended

    def _record(self, job: Job, ended: Ended) -> None:
        """Record how the attempt ended, with retries; the record refuses it if another attempt has the job by then."""
        retry = Retry(self._between, self.context.retry_for_s)
        record, about = self.context.record, f"job {job.id}: its end"
        if ended.outcome is AttemptOutcome.OUT_OF_MEMORY:
            attempts = self.context.settings.max_attempts
            try:
                retry.until_answered(about, lambda: record.leases.out_of_memory(job.id, job.attempt, attempts))
            finally:
                self.context.renew()
        elif ended.outcome in (AttemptOutcome.HANDED_BACK, AttemptOutcome.HANDED_OVER):
            reason = HANDED_OVER if ended.outcome is AttemptOutcome.HANDED_OVER else HANDED_BACK
            retry.until_answered(about, lambda: record.leases.release(job.id, job.attempt, reason))
        elif ended.may_pass and ended.error is not None:
            arguments = ended.error, self.context.settings.max_attempts, self.context.settings.retry_delay_s
            retry.until_answered(about, lambda: record.leases.postpone(job.id, job.attempt, *arguments))
        else:
            finish = partial(record.leases.finish, job.id, job.attempt, _TERMINAL[ended.outcome], ended.error)
            about_it = partial(finish, results=ended.results, step_s=ended.step_s, made_by=ended.made_by)
            retry.until_answered(about, about_it)

    def _between(self) -> None:
        self.context.pulse.beat()
        if self.context.stopping():
            raise UnavailableError("The worker is stopping.")

    def _leave(self, job: Job) -> None:
        try:
            self.context.record.leases.release(job.id, job.attempt, OUTAGE)
        except MeshdeformError as error:
            _log.warning("job %s: stays claimed until its lease expires: %s", job.id, error.detail)


def with_versions(artifacts: dict[str, ArtifactData], made_by: str) -> dict[str, ArtifactData]:
    """Return results whose report says so if several versions computed them."""
    report = artifacts.get("report.json")
    if report is None or ", " not in made_by:
        return artifacts
    told = json.loads(report.data)
    told["made_by"] = made_by.split(", ")
    one_after_the_other = made_by.replace(", ", ", then ")
    mixed = f"This was computed by Meshdeform {one_after_the_other}, and may differ from what one of them would make."
    told["warnings"] = [*told.get("warnings", ()), mixed]
    data = json.dumps(told, indent=2, allow_nan=False).encode()
    return {**artifacts, "report.json": ArtifactData(data, report.content_type)}


def _traced(job: Job) -> AbstractContextManager[None]:
    """Open a span in the trace of the request that created the job."""
    attributes: dict[str, str | int | float] = {
        "job.id": job.id,
        "job.kind": job.kind.value,
        "job.attempt": job.attempt,
    }
    return span("attempt", attributes, traceparent=job.traceparent)


def is_out_of_memory(error: BaseException | None) -> bool:
    """Return whether the error or one of its causes means that the device ran out of memory.

    Names and messages are compared instead of classes, which needs no torch and lets tests raise such an error.
    """
    while error is not None:
        if any(each.__name__ == _OUT_OF_MEMORY for each in type(error).__mro__):
            return True
        if isinstance(error, RuntimeError) and any(words in str(error) for words in _OUT_OF_MEMORY_WORDS):
            return True
        error = error.__cause__
    return False
