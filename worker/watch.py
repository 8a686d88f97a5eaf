"""Renew the lease, publish progress and detect a cancellation while the steps of a job run.

One thread writes to the record, another one subscribes to Redis. The loop that runs the steps only stores its newest
report here and reads flags, so that it never waits for the record or Redis, and the lease is renewed in time however
long a step takes.
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
from meshdeform.record.turns import USUAL, Turns
from meshdeform.runs.base import StepReport
from meshdeform.support.telemetry import carried

PUBLISH_EVERY_S = 0.5
"""Half the promised second, so that a slow write does not cause a longer gap."""
_HEARTBEATS_PER_LEASE = 6
_LONGEST_HEARTBEAT_S = 10.0
"""Upper limit, however long the lease is: heartbeats also renew the worker's own row, at least this often."""
_EVENTS_PER_JOB = 200
_EVENT_EVERY_S = 5.0
"""Progress events: one for each such fraction of all steps, and one after so many seconds if there is progress."""
_log = logging.getLogger(__name__)


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
