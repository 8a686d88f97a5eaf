"""Keep one worker process running, and the queue consistent with the record. Never imports torch.

The supervisor restarts, with back-off, a worker that died of a crash, the out-of-memory killer or a signal, and kills
one that hangs, or whose job is to end and does not (`overdue.py`). It also runs the reconciler, which takes jobs back
from dead workers.
"""

from __future__ import annotations

import logging
import os
import signal
import time

from meshdeform.errors import MeshdeformError, UnavailableError
from meshdeform.record.queue import JobQueue
from meshdeform.record.reconciler import Reconciler
from meshdeform.record.repository import JobRecord
from meshdeform.serving.processes import Child, SignalInbox, SupervisedChild, python_command
from meshdeform.settings import Settings
from meshdeform.support.failpoints import failpoint
from worker.health import OUT_OF_MEMORY, PULSE, STOP_GRACE_S, WORKER_ID, PulseMonitor, new_worker_id, sign_of_life
from worker.overdue import Overdue

_log = logging.getLogger(__name__)

PROCESS_MODULE = "worker.process"
_TEND_EVERY_S = 0.25
_OPEN_EVERY_S = 2.0
_LOADING_S = 120.0
"""Minimum seconds that a process has for its imports, however short the time limit of a step is."""
_STOP = frozenset({signal.SIGINT, signal.SIGTERM})


class Supervisor:
    """The supervisor of one worker process, whose module tests replace; it also runs the reconciler."""

    def __init__(self, settings: Settings, process_module: str = PROCESS_MODULE) -> None:
        self._settings, self._process_module = settings, process_module
        self._worker_id = ""
        self._monitor: PulseMonitor | None = None
        self._killed_at = 0.0

    def run(self) -> None:
        """Supervise the worker until SIGINT or SIGTERM, then let it hand its job back and exit.

        `DependencyError`: a URL in the settings is invalid. If the record merely does not answer, wait for it.
        """
        with SignalInbox(signal.SIGINT, signal.SIGTERM, signal.SIGCHLD) as inbox, sign_of_life(self._settings):
            record = self._open_record(inbox)
            if record is None:
                return
            queue = JobQueue(self._settings.redis_url, self._settings.queue)
            with Reconciler(
                record,
                queue,
                self._settings.max_attempts,
                self._settings.lease_s,
                max_running=self._settings.max_running_jobs,
            ):
                worker = SupervisedChild(
                    self._start_worker,
                    _log.warning,
                    lambda: self._give_up_lease(record),
                    at_once={OUT_OF_MEMORY},
                )
                overdue = Overdue(record, self._settings.max_run_s or 0.0, worker.restart)
                while not inbox.wait(_TEND_EVERY_S) & _STOP:
                    self._look_after(worker, overdue)
                    worker.supervise()
                worker.stop(STOP_GRACE_S)
                # The worker has handed its job back, unless it had to be killed.
                self._give_up_lease(record)
            queue.close()
            record.close()

    def _open_record(self, inbox: SignalInbox) -> JobRecord | None:
        """Return the record once it answers, as its server may start after this process; None if stopped first."""
        while True:
            try:
                return JobRecord(self._settings.resolved_database_url, connections=0)
            except UnavailableError as error:
                _log.warning("waiting for the record: %s", error.detail)
            if inbox.wait(_OPEN_EVERY_S) & _STOP:
                return None

    def _start_worker(self) -> Child:
        # The libraries used by torch and numba read these variables when they are loaded.
        threads = str(self._settings.threads)
        limits = {"OMP_NUM_THREADS": threads, "NUMBA_NUM_THREADS": threads} if self._settings.threads else {}
        # One thread for numpy's: two make a fit dearer, and its last bits other than those of its preview.
        limits["OPENBLAS_NUM_THREADS"] = os.environ.get("OPENBLAS_NUM_THREADS", "1")
        self._worker_id = new_worker_id()
        if self._monitor is not None:
            self._monitor.close()
        self._monitor, self._killed_at = PulseMonitor(), 0.0
        descriptor = self._monitor.descriptor
        environment = {**limits, WORKER_ID: self._worker_id, PULSE: str(descriptor)}
        command = python_command(self._process_module)
        return Child("worker process", command, env=environment, pass_fds=[descriptor])

    def _look_after(self, worker: SupervisedChild, overdue: Overdue) -> None:
        if self._monitor is None or worker.child.exit_code is not None:
            return
        silent_s = self._monitor.silent_s()
        self._kill_if_hung(worker, silent_s, loading=self._monitor.loading)
        overdue.look(self._worker_id, silent_s)

    def _kill_if_hung(self, worker: SupervisedChild, silent_s: float, *, loading: bool) -> None:
        limit_s = max(self._settings.step_timeout_s, _LOADING_S if loading else 0.0)
        if silent_s > limit_s and time.monotonic() > self._killed_at + limit_s:
            _log.error("the worker process has made no progress for %.0f s and is killed", silent_s)
            self._killed_at = time.monotonic()
            worker.child.kill()

    def _give_up_lease(self, record: JobRecord) -> None:
        """Remove the worker that just ended, so that its job is taken back before its lease expires."""
        try:
            if record.leases.worker_ended(self._worker_id):
                _log.warning("the worker process held a job, which is taken back")
                failpoint("supervisor.reclaimed")
        except MeshdeformError as error:
            _log.warning("the job of the worker process stays claimed until its lease expires: %s", error)
