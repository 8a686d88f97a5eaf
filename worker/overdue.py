"""Hold a job to its time, its turn and its cancellation in every phase.

The loop that runs the steps does so itself (`attempt.py`). In a long call of other code, as while a start or an end
counts the cuts of a mesh, it hears nothing: the supervisor then records how the attempt ended and replaces the process.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping
from typing import Any

from meshdeform.errors import MeshdeformError, RunTimeError
from meshdeform.record.leases import HANDED_OVER
from meshdeform.record.models import JobError, JobState
from meshdeform.record.repository import JobRecord
from meshdeform.record.upkeep import HeldJob

_log = logging.getLogger(__name__)

OPTIMIZING = "optimizing"
"""The phase of the steps."""

_DEAF_S = 1.5
"""Seconds without progress after which the record is asked whether the job is to end."""
_GRACE_S, _STEP_GRACE_S = 2.0, 30.0
"""Seconds that a worker then has to end it by itself, and those of a step whose time is over: it is kept if it ends."""
_ASK_EVERY_S, _ASK_AGAIN_S = 0.5, 10.0
"""Seconds between two questions, and after one that the record did not answer."""


def time_limit(request: Mapping[str, Any], max_run_s: float) -> float:
    """Return the seconds that a job may run: those of its request or of the settings (0: no limit)."""
    own = request.get("max_run_s")
    limits = [limit for limit in (own, max_run_s) if isinstance(limit, int | float) and limit > 0]
    return min(limits, default=math.inf)


def over_time(limit_s: float, doing: str) -> RunTimeError:
    """Return the error of a job that has run for as long as it may; `doing` says what it had done, or was doing."""
    return RunTimeError(f"The job has run for the {limit_s:g} s that it may run, and {doing}.")


class Overdue:
    """Ends the jobs of a worker process that makes no progress and does not end them itself.

    `replace` ends the process and starts the next one.
    """

    def __init__(self, record: JobRecord, max_run_s: float, replace: Callable[[], None]) -> None:
        self._record, self._max_run_s, self._replace = record, max_run_s, replace
        self._ask_at = 0.0
        self._since: tuple[str, float] | None = None

    def look(self, worker_id: str, silent_s: float) -> None:
        """Look after the process with this id, which has made no progress for so many seconds."""
        now = time.monotonic()
        if silent_s < _DEAF_S:
            self._since = None
        if silent_s < _DEAF_S or now < self._ask_at:
            return
        self._ask_at = now + _ASK_EVERY_S
        try:
            held = self._record.upkeep.held(worker_id)
            reason = None if held is None else self._reason(held)
            if held is None or reason is None:
                self._since = None
                return
            if self._since is None or self._since[0] != reason:
                self._since = reason, now
            patient = reason == "over" and held.phase == OPTIMIZING
            if now - self._since[1] >= (_STEP_GRACE_S if patient else _GRACE_S):
                self._end(held, reason)
        except MeshdeformError as error:
            _log.warning("the end of a job may take longer: %s", error)
            self._ask_at = now + _ASK_AGAIN_S

    def _reason(self, held: HeldJob) -> str | None:
        if held.canceled:
            return "canceled"
        if held.ran_s >= self._limit_s(held):
            return "over"
        # A step is waited for: what it has done is kept.
        return "yields" if held.yields and held.phase != OPTIMIZING else None

    def _limit_s(self, held: HeldJob) -> float:
        return time_limit(held.document if isinstance(held.document, dict) else {}, self._max_run_s)

    def _end(self, held: HeldJob, reason: str) -> None:
        # First: the worker can write nothing more, and if it has just ended the job, it is left alone.
        leases, job = self._record.leases, (held.id, held.attempt)
        if reason == "canceled":
            leases.finish(*job, JobState.CANCELED)
        elif reason == "over":
            error = over_time(self._limit_s(held), f"was {held.phase}")
            leases.finish(*job, JobState.FAILED, JobError.of(error))
        else:
            leases.release(*job, HANDED_OVER)
        _log.warning("job %s: %s; the worker process does not stop by itself and is replaced", held.id, reason)
        self._since = None
        self._replace()
