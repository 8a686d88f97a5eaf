"""Run one attempt at a job, from the claim to exactly one of: succeeded, failed, canceled, handed back, or lost.

Store the checkpoints and results of an attempt. Each is uploaded and read back before the record refers to it.

While the store or the record does not answer, an operation is repeated, up to a time limit.

Renew the lease, publish progress and detect a cancellation while the steps of a job run.

One thread writes to the record, another one subscribes to Redis. The loop that runs the steps only stores its newest
report here and reads flags, so that it never waits for the record or Redis, and the lease is renewed in time however
long a step takes.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self, TypeVar

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
from meshdeform.record.leases import HANDED_BACK, HANDED_OVER, OUTAGE, USUAL, Leases, Turns, WorkerIdentity
from meshdeform.record.models import Artifact, CheckpointRef, Job, JobError, JobState, OriginMode, Progress, StoredFile
from meshdeform.record.repository import JobRecord
from meshdeform.runs.base import ArtifactData, InputFile, JobRun, RunInput, StartRun, StepReport
from meshdeform.runs.costs import END_SHARE, costs_of
from meshdeform.runs.kept_readings import FolderReadings, Several
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from meshdeform.storage.readings import StoredReadings
from meshdeform.support.failpoints import failpoint
from meshdeform.support.sources import build
from meshdeform.support.telemetry import bound, carried, span
from worker.health import Pulse
from worker.overdue import OPTIMIZING, over_time, time_limit

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

_log = logging.getLogger(__name__)

_OUT_OF_MEMORY = "OutOfMemoryError"
# Messages of CUDA and its libraries for which torch has no exception class.
_OUT_OF_MEMORY_WORDS = ("CUDA error: out of memory", "CUBLAS_STATUS_ALLOC_FAILED", "CUDNN_STATUS_ALLOC_FAILED")


RETRY_FOR_S = 600.0
"""Maximum seconds of an outage before an attempt leaves its job to another one."""
T = TypeVar("T")
_FIRST_S, _LONGEST_S = 0.1, 2.0
_CONTENT_TYPE = "application/octet-stream"
_PAUSE_S, _PAUSE_PER_S = 1.0, 2.0
"""After a failure: the minimum pause, and its length per second that the failure took, so that steps get most time."""
PUBLISH_EVERY_S = 0.5
"""Half the promised second, so that a slow write does not cause a longer gap."""
_HEARTBEATS_PER_LEASE = 6
_LONGEST_HEARTBEAT_S = 10.0
"""Upper limit, however long the lease is: heartbeats also renew the worker's own row, at least this often."""
_EVENTS_PER_JOB = 200
_EVENT_EVERY_S = 5.0
"""Progress events: one for each such fraction of all steps, and one after so many seconds if there is progress."""


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

    def __init__(self, at: WorkerContext, job: Job, watch: JobWatch) -> None:
        self._at, self._job, self._watch = at, job, watch
        self._retry = Retry(self._go_on, at.retry_for_s)
        self._checkpoints = CheckpointStore(at.record, at.store, job, at.settings.checkpoints_kept)
        self._run: JobRun | None = None
        self._made_by = build()
        self._steps, self._steps_s = 0, 0.0
        self._max_run_s = time_limit(job.document, at.settings.max_run_s)
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
        artifacts = versions_told(run.finish(), self._made_by)
        failpoint("worker.finished")
        if self._watch.canceled:
            return self._ended(AttemptOutcome.CANCELED)
        self._phase("uploading")
        with span("upload"):
            results = store_results(self._at.store, self._job, artifacts, self._retry)
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
            self._at.pulse.beat()
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
            prior = self._at.load_prior(model)
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
                default_model=self._at.settings.model,
                limits=Limits.from_settings(self._at.settings),
                device=self._at.device,
                readings=Several(FolderReadings(self._at.settings.cache_folder), StoredReadings(self._at.store)),
                on_wait=self._go_on,
            )
            return self._at.start(job_input)

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
        data = self._retry.until_answered(what, lambda: self._at.store.get(file.key, sha256=file.sha256))
        return InputFile(data, file.filename, file.sha256)

    def _phase(self, name: str, run: JobRun | None = None) -> None:
        self._at.pulse.beat()
        if self._watch.canceled:
            raise _InterruptedError
        if run is None:
            self._watch.phase(name)
        else:
            self._watch.phase(name, step=run.step, total_steps=run.total_steps)

    def _must_stop(self) -> bool:
        if self._watch.lost:
            raise StaleAttemptError("The lease is lost.")
        return self._watch.canceled or self._at.stopping()

    def _go_on(self) -> None:
        self._at.pulse.beat()
        if self._must_stop() or self._watch.yields:
            raise _InterruptedError
        if time.monotonic() >= self._ends:
            raise over_time(self._max_run_s, f"was {self._watch.doing}")

    def _interrupted(self) -> AttemptOutcome:
        if self._watch.canceled:
            return AttemptOutcome.CANCELED
        return AttemptOutcome.HANDED_BACK if self._at.stopping() else AttemptOutcome.HANDED_OVER

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
        leases = self._at.record.leases
        others = self._retry.until_answered("the other workers", lambda: leases.alive(self._at.worker.queue)) > 1
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

    at: WorkerContext

    def run(self, job_id: str) -> None:
        """Run the next job, which need not be `job_id`: that is the job for which a message was sent, if there was one.

        Errors of the job are recorded and not raised. If the record or the store does not answer for too long, the job
        returns to the queue, or stays claimed until its lease expires if even that cannot be written.
        `UnavailableError`: the record does not answer, so nothing is claimed.
        """
        failpoint("worker.told")
        self.at.pulse.beat()
        try:
            # The job that may start now that this one has stopped may have no message left.
            while self._run_one(job_id):
                job_id = ""
        finally:
            self.at.pulse.rest()

    def _run_one(self, job_id: str) -> bool:
        """Run the next job, and return whether to look for another one at once."""
        job = self.at.record.leases.claim_next(self.at.worker.id, self.at.settings.lease_s, self._turns)
        if job is None:
            if job_id:
                _log.info("message for job %s, but none is queued (a duplicate, or another worker has it)", job_id)
            return False
        with bound(job_id=job.id, request_id=job.request_id or ""), _traced(job):
            if job_id and job.id != job_id:
                _log.info("message for job %s; job %s comes first", job_id, job.id)
            outcome = self._claimed(job)
        limited = self._turns.max_running and outcome is not AttemptOutcome.OUT_OF_MEMORY
        return bool(limited or outcome is AttemptOutcome.HANDED_OVER) and not self.at.stopping()

    @property
    def _turns(self) -> Turns:
        return Turns.of(self.at.settings)

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
        at, leases = self.at, self.at.record.leases
        end_s = END_SHARE * costs_of(job.request.workload).seconds(job.faces, job.meshes, None).once
        listen = partial(at.listen, job.id)
        with JobWatch(leases, at.worker, job, listen, at.settings.lease_s, self._turns, end_s) as watch:
            ended = Attempt(at, job, watch).run()
            if watch.lost:
                raise StaleAttemptError("The lease is lost.")
        return ended

    def _record(self, job: Job, ended: Ended) -> None:
        """Record how the attempt ended, with retries; the record refuses it if another attempt has the job by then."""
        retry = Retry(self._between, self.at.retry_for_s)
        record, about = self.at.record, f"job {job.id}: its end"
        if ended.outcome is AttemptOutcome.OUT_OF_MEMORY:
            attempts = self.at.settings.max_attempts
            try:
                retry.until_answered(about, lambda: record.leases.out_of_memory(job.id, job.attempt, attempts))
            finally:
                self.at.renew()
        elif ended.outcome in (AttemptOutcome.HANDED_BACK, AttemptOutcome.HANDED_OVER):
            reason = HANDED_OVER if ended.outcome is AttemptOutcome.HANDED_OVER else HANDED_BACK
            retry.until_answered(about, lambda: record.leases.release(job.id, job.attempt, reason))
        elif ended.may_pass and ended.error is not None:
            arguments = ended.error, self.at.settings.max_attempts, self.at.settings.retry_delay_s
            retry.until_answered(about, lambda: record.leases.postpone(job.id, job.attempt, *arguments))
        else:
            finish = partial(record.leases.finish, job.id, job.attempt, _TERMINAL[ended.outcome], ended.error)
            about_it = partial(finish, results=ended.results, step_s=ended.step_s, made_by=ended.made_by)
            retry.until_answered(about, about_it)

    def _between(self) -> None:
        self.at.pulse.beat()
        if self.at.stopping():
            raise UnavailableError("The worker is stopping.")

    def _leave(self, job: Job) -> None:
        try:
            self.at.record.leases.release(job.id, job.attempt, OUTAGE)
        except MeshdeformError as error:
            _log.warning("job %s: stays claimed until its lease expires: %s", job.id, error.detail)


def versions_told(artifacts: dict[str, ArtifactData], made_by: str) -> dict[str, ArtifactData]:
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


class Retry:
    """Retries of operations that raise `UnavailableError`, each for at most `limit_s` seconds.

    `between` is called before each retry; it ends the retries by an exception if the lease is lost or the job canceled.
    """

    def __init__(self, between: Callable[[], None], limit_s: float = RETRY_FOR_S) -> None:
        self._between, self._limit_s = between, limit_s

    def until_answered(self, what: str, action: Callable[[], T]) -> T:
        """Call a repeatable `action` until it does not raise `UnavailableError`, and return its result.

        `what` describes the action for the log. `UnavailableError`: the time limit is exceeded.
        """
        end, delay = time.monotonic() + self._limit_s, _FIRST_S
        while True:
            try:
                return action()
            except UnavailableError as error:
                if time.monotonic() + delay > end:
                    raise
                _log.warning("%s: %s Retrying.", what, error.detail)
            time.sleep(delay)
            self._between()
            delay = min(2 * delay, _LONGEST_S)


class CheckpointStore:
    """The checkpoints of one attempt at a job, the newest `kept` of them, and those left by earlier attempts.

    The attempt is part of the keys, so that two attempts never write the same object. `step` is the newest step stored
    by this attempt; 0 for none. `made_by`: the versions that compute what it stores.
    """

    def __init__(self, record: JobRecord, store: ObjectStore, job: Job, kept: int) -> None:
        self._record, self._store, self._job, self._kept = record, store, job, kept
        self._not_before = 0.0
        self._missed = False
        self.step = 0
        self.made_by = build()

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


class CancelListener(Protocol):
    """A subscription to hints that a job may have been canceled."""

    def wait(self, timeout_s: float) -> bool:
        """Return True when a hint arrives; False after `timeout_s` seconds. Never raises."""


class StepTimer:
    """The smoothed duration of a step, for estimates: an exponential mean over about twenty steps.

    The first step is left out: it compiles and allocates, and takes many times as long as the others.
    """

    _MEMORY_STEPS = 20

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._last = clock()
        self._steps = 0
        self._mean_s = 0.0

    def start(self) -> None:
        """Start the next step; the time before it does not count."""
        self._last = self._clock()

    def tick(self) -> None:
        """Count a finished step."""
        now = self._clock()
        elapsed, self._last = now - self._last, now
        self._steps += 1
        if self._steps > 1:
            self._mean_s += (elapsed - self._mean_s) / min(self._steps - 1, self._MEMORY_STEPS)

    def left_s(self, steps: int) -> float | None:
        """Return the seconds that `steps` more steps will take; None before the second step."""
        return None if self._steps < 2 else self._mean_s * steps


class JobWatch:
    """The watch over one attempt, for the duration of a `with` block: one thread writes, one waits for a cancellation.

    `listen` opens a `CancelListener` for the job. The lease is renewed every sixth of it, at least every ten seconds.
    `end_s` are the seconds that the job is expected to need after its last step.
    Once `canceled`, stop after this step; once `yields`, after one whose checkpoint is stored: another job has waited
    for its turn. Once `lost`, another attempt has the job: stop, and write nothing more.
    """

    def __init__(
        self,
        leases: Leases,
        worker: WorkerIdentity,
        job: Job,
        listen: Callable[[], AbstractContextManager[CancelListener]],
        lease_s: float,
        turns: Turns = USUAL,
        end_s: float = 0.0,
    ) -> None:
        self._leases, self._worker, self._job, self._listen = leases, worker, job, listen
        self._lease_s, self._turns, self._began = lease_s, turns, time.monotonic()
        self._turn_s: float | None = None
        self._end_s = end_s
        self._heartbeat_every_s = min(lease_s / _HEARTBEATS_PER_LEASE, _LONGEST_HEARTBEAT_S)
        self._timer = StepTimer()
        self._latest = self._progress(job.progress.step, job.progress.total_steps, "loading", {})
        self._published: Progress | None = None
        self._last_event: Progress | None = None
        self._last_event_at = 0.0
        self._done, self._wake = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=carried(self._run), name=f"watch {job.id}", daemon=True)
        self._cancel_listener = threading.Thread(
            target=carried(self._listen_for_cancel), name=f"cancel {job.id}", daemon=True
        )
        self.canceled = job.state is JobState.CANCELING
        self.lost = self.yields = False

    def __enter__(self) -> Self:
        self._thread.start()
        self._cancel_listener.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._wake.set()
        self._thread.join()
        # The cancel listener ends within half a second by itself; the end of the job need not wait for it.

    def phase(self, name: str, *, step: int | None = None, total_steps: int | None = None) -> None:
        """Enter a phase that has no steps of its own."""
        at = self._latest
        self._latest = self._progress(
            at.step if step is None else step, at.total_steps if total_steps is None else total_steps, name, at.losses
        )
        self._timer.start()

    @property
    def doing(self) -> str:
        """The phase."""
        return self._latest.phase

    def step(self, report: StepReport) -> None:
        """Note a finished step. This takes microseconds: the thread publishes it."""
        self._timer.tick()
        self._latest = self._progress(report.step, report.total_steps, self._latest.phase, report.losses)

    def _progress(self, step: int, total_steps: int, phase: str, losses: dict[str, float]) -> Progress:
        left_s = self._timer.left_s(total_steps - step) if total_steps else None
        return Progress(
            step=step,
            total_steps=total_steps,
            fraction=step / total_steps if total_steps else 0.0,
            phase=phase,
            losses={name: value for name, value in losses.items() if math.isfinite(value)},
            eta_s=None if left_s is None else left_s + self._end_s * (phase != "uploading"),
            attempt=self._job.attempt,
        )

    def _run(self) -> None:
        next_heartbeat = next_sign = 0.0
        try:
            while True:
                hinted = self._wake.is_set()
                self._wake.clear()
                if self._done.is_set() or self.lost:
                    break
                now = time.monotonic()
                if due := hinted or now >= next_heartbeat:
                    next_heartbeat = now + self._heartbeat_every_s
                if due and now >= next_sign:
                    # With the sign of life of the worker itself, which need not be renewed as often as a short lease.
                    next_sign = now + _LONGEST_HEARTBEAT_S - self._heartbeat_every_s / 2
                    self._attempt(lambda: self._beat(self._worker))
                elif due and self._latest is self._published:
                    self._attempt(self._beat)
                elif due:
                    # One statement for both.
                    self._attempt(lambda: self._publish(self._lease_s))
                if due and now >= self._began + self._turns.turn_s and not self.yields:
                    self._attempt(self._look_who_waits)
                self._attempt(self._publish)
                self._wake.wait(min(PUBLISH_EVERY_S, self._heartbeat_every_s))
            self._attempt(self._publish)
        except Exception:
            # Without its watch the job would run on until its lease expires and then lose its work: stop it now.
            _log.exception("job %s: the watch failed", self._job.id)
            self.lost = True

    def _listen_for_cancel(self) -> None:
        try:
            with self._listen() as listener:
                while not (self._done.is_set() or self.lost or self.canceled):
                    if listener.wait(PUBLISH_EVERY_S):
                        # Only the record is believed: ask it now, and again only after a moment.
                        self._wake.set()
                        self._done.wait(PUBLISH_EVERY_S)
        except Exception:
            _log.exception("job %s: a cancellation will only be noticed at the next heartbeat", self._job.id)

    def _attempt(self, write: Callable[[], None]) -> None:
        """Write to the record; if it does not answer, continue, because the lease outlasts a short outage."""
        if self.lost:
            return
        try:
            write()
        except (StaleAttemptError, NotFoundError):
            self.lost = True
        except MeshdeformError as error:
            _log.warning("job %s: %s", self._job.id, error)

    def _beat(self, worker: WorkerIdentity | None = None) -> None:
        self._note(self._leases.heartbeat(self._job.id, self._job.attempt, self._lease_s, worker=worker))

    def _look_who_waits(self) -> None:
        if self._turn_s is None:
            # What has no steps begins anew after a hand-over. Each turn is twice as long, so that it ends some day.
            self._turn_s = self._turns.turn_s * 2.0 ** self._leases.fruitless(self._job)
        if time.monotonic() >= self._began + self._turn_s:
            self.yields = self._leases.hand_over(self._job, self._turns)

    def _note(self, state: JobState) -> None:
        if state is JobState.CANCELING:
            self.canceled = True

    def _publish(self, lease_s: float | None = None) -> None:
        latest = self._latest
        if latest is not self._published:
            as_event = self._deserves_event(latest)
            job = self._job
            state = self._leases.save_progress(job.id, job.attempt, latest, as_event=as_event, lease_s=lease_s)
            self._note(state)
            self._published = latest
            if as_event:
                self._last_event, self._last_event_at = latest, time.monotonic()

    def _deserves_event(self, progress: Progress) -> bool:
        """Return whether to write an event; a job of many hours must not create a hundred thousand of them."""
        last = self._last_event
        return (
            last is None
            or progress.phase != last.phase
            or (progress.step - last.step) * _EVENTS_PER_JOB >= progress.total_steps
            or time.monotonic() - self._last_event_at >= _EVENT_EVERY_S
        )
