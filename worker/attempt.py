"""What one attempt does between the claim and its end: start, steps with checkpoints, results."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import TYPE_CHECKING

from meshdeform.assets import Limits
from meshdeform.errors import CheckpointError, MeshdeformError, StaleAttemptError, UnavailableError
from meshdeform.record.models import Artifact, Job, JobError, OriginMode, StoredFile
from meshdeform.runs.base import InputFile, JobRun, RunInput
from meshdeform.support.failpoints import failpoint
from meshdeform.support.telemetry import span
from worker.context import WorkerContext
from worker.outputs import CheckpointStore, store_results
from worker.retry import Retry
from worker.watch import JobWatch

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["Attempt", "Ended", "Outcome", "is_out_of_memory"]

_log = logging.getLogger(__name__)

_OUT_OF_MEMORY = "OutOfMemoryError"
# What CUDA and its libraries say where torch has no class for it.
_OUT_OF_MEMORY_WORDS = ("CUDA error: out of memory", "CUBLAS_STATUS_ALLOC_FAILED", "CUDNN_STATUS_ALLOC_FAILED")


class Outcome(Enum):
    """How an attempt ended."""

    SUCCEEDED = auto()
    FAILED = auto()
    CANCELED = auto()
    HANDED_BACK = auto()
    OUT_OF_MEMORY = auto()


@dataclass(frozen=True)
class Ended:
    """The end of an attempt, not yet on the record.

    Attributes
    ----------
    outcome : Outcome
    results : list of Artifact
        Stored; where it succeeded.
    error : JobError, optional
        Where it failed.
    step_s : float, optional
        Mean seconds of a step; None where it did none.
    """

    outcome: Outcome
    results: list[Artifact] = field(default_factory=list)
    error: JobError | None = None
    step_s: float | None = None


class _InterruptedError(Exception):
    """The job is canceled, or the process is to end, while something is waited for."""


class Attempt:
    """One attempt at one job.

    Parameters
    ----------
    at : WorkerContext
    job : Job
        As claimed.
    watch : JobWatch
        Running.
    """

    def __init__(self, at: WorkerContext, job: Job, watch: JobWatch) -> None:
        self._at, self._job, self._watch = at, job, watch
        self._retry = Retry(self._go_on, at.retry_for_s)
        self._checkpoints = CheckpointStore(at.record, at.store, job, at.settings.checkpoints_kept)
        self._run: JobRun | None = None
        self._steps, self._steps_s = 0, 0.0

    def run(self) -> Ended:
        """Do it.

        Raises
        ------
        StaleAttemptError
            Another attempt has the job, or it is over: a deadline, say.
        UnavailableError
            The store or the record has not answered for too long.
        """
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
        self._phase("optimizing", run)
        if self._must_stop():
            return self._stopped()
        with span("optimize"):
            through = self._optimize(run)
        if not through:
            return self._stopped()
        self._phase("writing")
        artifacts = run.finish()
        failpoint("worker.finished")
        if self._watch.canceled:
            return self._ended(Outcome.CANCELED)
        self._phase("uploading")
        with span("upload"):
            results = store_results(self._at.store, self._job, artifacts, self._retry)
        failpoint("worker.results.stored")
        if self._watch.canceled:
            return self._ended(Outcome.CANCELED)
        return self._ended(Outcome.SUCCEEDED, results=results)

    def _optimize(self, run: JobRun) -> bool:
        """Do the steps that are left; False where the job must stop before its end."""
        every = self._job.request.params.checkpoint_every_steps
        began = time.monotonic()
        for report in run:
            self._steps, self._steps_s = self._steps + 1, self._steps_s + time.monotonic() - began
            self._at.pulse.beat()
            self._watch.step(report)
            failpoint("worker.step")
            stop = self._must_stop()
            due = report.step < report.total_steps and self._checkpoints.due(report.step, every)
            # A canceled job needs no checkpoint; one that is handed back needs it most of all.
            if (due or stop) and not self._watch.canceled:
                self._checkpoints.try_to_save(run)
            if stop:
                return False
            began = time.monotonic()
        return True

    def _start(self) -> JobRun:
        """Start from the newest checkpoint that can be used, else from what the job begins with."""
        job = self._job
        files = {"asset": self._input("asset", job.asset)}
        if job.target:
            files["target"] = self._input("target", job.target)

        def load_prior(model: str) -> Prior:
            self._at.pulse.beat()
            prior = self._at.load_prior(model)
            self._at.pulse.beat()
            return prior

        def start(checkpoint: bytes | None = None, initial: bytes | None = None) -> JobRun:
            self._at.pulse.beat()
            given = RunInput(
                request=job.request,
                files=files,
                resolved=job.resolved,
                checkpoint=checkpoint,
                initial=initial,
                load_prior=load_prior,
                default_model=self._at.settings.model,
                limits=Limits.from_settings(self._at.settings),
                device=self._at.device,
            )
            return self._at.start(given)

        for checkpoint in self._checkpoints.usable(self._retry):
            try:
                run = start(checkpoint)
            except CheckpointError as error:
                _log.warning("job %s: %s", job.id, error)
                continue
            _log.info("job %s: goes on from step %d", job.id, run.step)
            return run
        if job.origin is None or not job.origin.key:
            return start()
        origin = self._checkpoints.origin(self._retry)
        if job.origin.mode is OriginMode.BRANCH:
            if origin is None:
                raise CheckpointError(f"The checkpoint of job {job.origin.job_id} cannot be read any more.")
            return start(initial=origin)
        try:
            return start(origin)
        except CheckpointError as error:
            # The same request: from the beginning it comes to the same result.
            _log.warning("job %s: begins anew: %s", job.id, error)
            return start()

    def _input(self, name: str, file: StoredFile) -> InputFile:
        """Read a file of the job and verify its SHA-256."""
        what = f"job {self._job.id}: the {name}"
        data = self._retry.until_answered(what, lambda: self._at.store.get(file.key, sha256=file.sha256))
        return InputFile(data, file.filename, file.sha256)

    def _phase(self, name: str, run: JobRun | None = None) -> None:
        self._at.pulse.beat()
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
        if self._must_stop():
            raise _InterruptedError

    def _stopped(self) -> Ended:
        return self._ended(Outcome.CANCELED if self._watch.canceled else Outcome.HANDED_BACK)

    def _failed(self, error: Exception) -> Ended:
        if isinstance(error, MeshdeformError):
            _log.warning("job %s: failed: %s", self._job.id, error)
            return self._ended(Outcome.FAILED, error=JobError.of(error))
        _log.error("job %s: failed", self._job.id, exc_info=error)
        # What an unforeseen error says may hold paths of this machine: it stays in the log.
        unknown = MeshdeformError("The worker met an error that it does not know; its log has it.")
        return self._ended(Outcome.FAILED, error=JobError.of(unknown))

    def _out_of_memory(self, error: Exception) -> Ended:
        """Save what can be saved: the state is that of before the step that found no memory."""
        _log.warning("job %s: the device is out of memory: %s", self._job.id, error)
        run = self._run
        if run is not None and run.step > self._checkpoints.step and not self._watch.canceled:
            try:
                self._checkpoints.try_to_save(run, mesh=False)
            except StaleAttemptError:
                raise
            except Exception:
                _log.exception("job %s: no checkpoint of step %d", self._job.id, run.step)
        return self._ended(Outcome.OUT_OF_MEMORY)

    def _ended(
        self, outcome: Outcome, *, results: list[Artifact] | None = None, error: JobError | None = None
    ) -> Ended:
        step_s = self._steps_s / self._steps if self._steps else None
        return Ended(outcome, results or [], error, step_s)


def is_out_of_memory(error: BaseException | None) -> bool:
    """Return whether the error, or the one that it was made of, says that the device ran out of memory.

    Names and words are compared, not classes: that needs no torch, and a fake may raise one as well.
    """
    while error is not None:
        if any(each.__name__ == _OUT_OF_MEMORY for each in type(error).__mro__):
            return True
        if isinstance(error, RuntimeError) and any(words in str(error) for words in _OUT_OF_MEMORY_WORDS):
            return True
        error = error.__cause__
    return False
