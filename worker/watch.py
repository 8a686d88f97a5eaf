"""Keep the lease, publish progress and hear of a cancel, beside the steps of a job.

One thread writes to the record, another one listens on Redis. The loop that runs the steps only leaves its newest
report here and looks at flags, so it never waits for the record or for Redis; and however long a step takes, the lease
is renewed in time.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Protocol, Self

from meshdeform.errors import MeshdeformError, NotFoundError, StaleAttemptError
from meshdeform.record.leases import Leases, WorkerIdentity
from meshdeform.record.models import Job, JobState, Progress
from meshdeform.runs.base import StepReport
from meshdeform.support.logs import carried

__all__ = ["CancelListener", "JobWatch", "StepTimer"]

_log = logging.getLogger(__name__)

PUBLISH_EVERY_S = 0.5
"""Twice as often as promised, so that a slow write does not make a gap of more than a second."""

_HEARTBEATS_PER_LEASE = 6
_LONGEST_HEARTBEAT_S = 10.0
"""However long the lease is: the worker's row, which says that it is alive, is renewed with it."""

_TOLD_PARTS = 200
_TOLD_EVERY_S = 5.0
"""An event for each of so many parts of the way, and one at least so often while there is anything new."""


class CancelListener(Protocol):
    """Hears that somebody asked for a job to be canceled."""

    def wait(self, timeout_s: float) -> bool:
        """True when it was asked for; False when `timeout_s` seconds went by. Never raises."""


class StepTimer:
    """A smoothed duration of a step, for the estimate of what is left: an exponential mean of about twenty steps.

    The first step is left out: it compiles and allocates, and takes many times as long as the others.
    """

    _MEMORY_STEPS = 20

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._last = clock()
        self._steps = 0
        self._mean_s = 0.0

    def start(self) -> None:
        """The next step begins now; time before it is not a step's."""
        self._last = self._clock()

    def tick(self) -> None:
        """A step is done."""
        now = self._clock()
        taken, self._last = now - self._last, now
        self._steps += 1
        if self._steps > 1:
            self._mean_s += (taken - self._mean_s) / min(self._steps - 1, self._MEMORY_STEPS)

    def left_s(self, steps: int) -> float | None:
        """Return the seconds that `steps` more steps will take; None before the second step."""
        return None if self._steps < 2 else self._mean_s * steps


class JobWatch:
    """Watches over one attempt, in threads of its own, for the length of a `with` block: one writes, one hears.

    Parameters
    ----------
    leases : Leases
    worker : WorkerIdentity
    job : Job
        As claimed.
    listen : callable
        Opens a `CancelListener` for the job.
    lease_s : float
        Renewed six times as often as it lasts, and every ten seconds at least.

    Attributes
    ----------
    canceled : bool
        Somebody asked for the job to be canceled: stop after this step.
    lost : bool
        Another attempt has the job: stop, and write nothing more.
    """

    def __init__(
        self,
        leases: Leases,
        worker: WorkerIdentity,
        job: Job,
        listen: Callable[[], AbstractContextManager[CancelListener]],
        lease_s: float,
    ) -> None:
        self._leases, self._worker, self._job, self._listen = leases, worker, job, listen
        self._lease_s = lease_s
        self._heartbeat_every_s = min(lease_s / _HEARTBEATS_PER_LEASE, _LONGEST_HEARTBEAT_S)
        self._timer = StepTimer()
        self._latest = self._progress(0, 0, "loading", {})
        self._published: Progress | None = None
        self._told: Progress | None = None
        self._told_at = 0.0
        self._done = threading.Event()
        self._thread = threading.Thread(target=carried(self._run), name=f"watch {job.id}", daemon=True)
        self._cancel_listener = threading.Thread(
            target=carried(self._listen_for_cancel), name=f"cancel {job.id}", daemon=True
        )
        self.canceled = job.state is JobState.CANCELING
        self.lost = False

    def __enter__(self) -> Self:
        self._thread.start()
        self._cancel_listener.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()
        # The cancel listener ends within half a second. Nothing wakes it, and the end of the job need not wait for it.

    def phase(self, name: str, *, step: int | None = None, total_steps: int | None = None) -> None:
        """A phase begins that has no steps of its own."""
        at = self._latest
        self._latest = self._progress(
            at.step if step is None else step, at.total_steps if total_steps is None else total_steps, name, at.losses
        )
        self._timer.start()

    def step(self, report: StepReport) -> None:
        """A step is done. Costs microseconds: it is published from the thread."""
        self._timer.tick()
        self._latest = self._progress(report.step, report.total_steps, self._latest.phase, report.losses)

    def _progress(self, step: int, total_steps: int, phase: str, losses: dict[str, float]) -> Progress:
        return Progress(
            step=step,
            total_steps=total_steps,
            fraction=step / total_steps if total_steps else 0.0,
            phase=phase,
            losses={name: value for name, value in losses.items() if math.isfinite(value)},
            eta_s=self._timer.left_s(total_steps - step) if total_steps else None,
            attempt=self._job.attempt,
        )

    def _run(self) -> None:
        next_heartbeat = 0.0
        try:
            while not self._done.is_set() and not self.lost:
                now = time.monotonic()
                if now >= next_heartbeat:
                    next_heartbeat = now + self._heartbeat_every_s
                    self._attempt(self._beat)
                self._attempt(self._publish)
                self._done.wait(min(PUBLISH_EVERY_S, self._heartbeat_every_s))
            self._attempt(self._publish)
        except Exception:
            # Without its watch the job would go on unheard until its lease is over: better to stop it now.
            _log.exception("job %s: the watch ended", self._job.id)
            self.lost = True

    def _listen_for_cancel(self) -> None:
        try:
            with self._listen() as listener:
                while not (self._done.is_set() or self.lost or self.canceled):
                    if listener.wait(PUBLISH_EVERY_S):
                        self.canceled = True
        except Exception:
            _log.exception("job %s: a cancel will be noticed by the next heartbeat only", self._job.id)

    def _attempt(self, write: Callable[[], None]) -> None:
        """Write to the record; while it does not answer, go on: the lease outlives a short outage."""
        if self.lost:
            return
        try:
            write()
        except (StaleAttemptError, NotFoundError):
            self.lost = True
        except MeshdeformError as error:
            _log.warning("job %s: %s", self._job.id, error)

    def _beat(self) -> None:
        state = self._leases.heartbeat(self._job.id, self._job.attempt, self._lease_s, worker=self._worker)
        if state is JobState.CANCELING:
            self.canceled = True

    def _publish(self) -> None:
        latest = self._latest
        if latest is not self._published:
            tell = self._worth_telling(latest)
            self._leases.save_progress(self._job.id, self._job.attempt, latest, tell=tell)
            self._published = latest
            if tell:
                self._told, self._told_at = latest, time.monotonic()

    def _worth_telling(self, progress: Progress) -> bool:
        """Return whether it should become an event; a job of many hours must not leave a hundred thousand of them."""
        told = self._told
        return (
            told is None
            or progress.phase != told.phase
            or (progress.step - told.step) * _TOLD_PARTS >= progress.total_steps
            or time.monotonic() - self._told_at >= _TOLD_EVERY_S
        )
