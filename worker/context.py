"""What a worker process has at hand; made once, and shared by all attempts at all jobs."""

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
from worker.pulse import Pulse
from worker.retry import RETRY_FOR_S
from worker.watch import CancelListener

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["WorkerContext"]


@dataclass(frozen=True)
class WorkerContext:
    """Hold the settings, the record, the store, and what starts a run.

    Attributes
    ----------
    settings : Settings
    record, store : JobRecord, ObjectStore
    listen : callable
        Opens a listener for the cancel of a job.
    start : StartRun
        Starts a run of any kind: `meshdeform.runs.start_run`, which imports what the kind needs.
    load_prior : callable
        Gives the prior of a model; keeps it between jobs.
    device : str
    stopping : callable
        True once this process is to end: the job is then handed back after its step.
    worker : WorkerIdentity
        Whose leases those of this process are.
    renew : callable
        Ends this process after the job, because its device ran out of memory; the next one has a clean context.
    pulse : Pulse
        Tells the supervisor that something moves.
    retry_for_s : float
        How long an outage of the store or the record may last before a job is left to another attempt.
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
