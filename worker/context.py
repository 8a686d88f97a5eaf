"""The dependencies of a worker process, created once and shared by all attempts."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.repository import JobRecord
from meshdeform.runs.base import StartRun
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from worker.health import Pulse
from worker.outputs import RETRY_FOR_S
from worker.watch import CancelListener

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["WorkerContext"]


@dataclass(frozen=True)
class WorkerContext:
    """The settings, the record, the store, and the functions that start a run.

    Attributes
    ----------
    listen : callable
        Opens a listener for the cancellation of a job.
    start : StartRun
        Starts a run of any kind: `meshdeform.runs.start_run`, which imports the kind's dependencies.
    load_prior : callable
        Returns the prior of a model and keeps it between jobs.
    stopping : callable
        Returns True once this process is stopping: the job is then handed back after its current step.
    worker : WorkerIdentity
        The holder of this process's leases.
    renew : callable
        Ends this process after the job because its device ran out of memory; its successor has a clean context.
    pulse : Pulse
        Shows the supervisor that the worker makes progress.
    retry_for_s : float
        Maximum seconds of an outage of the store or the record before the job is left to another attempt.
    """

    settings: Settings
    record: JobRecord
    store: ObjectStore
    listen: Callable[[str], AbstractContextManager[CancelListener]]
    start: StartRun
    load_prior: Callable[[str], Prior]
    device: str
    stopping: Callable[[], bool]
    worker: WorkerIdentity
    renew: Callable[[], None]
    pulse: Pulse = field(default_factory=Pulse)
    retry_for_s: float = RETRY_FOR_S
