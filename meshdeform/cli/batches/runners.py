"""Run rows in several threads, each in a process of this machine or as a job of a service.

A process keeps the model in memory from row to row, and a crash fails one row, not the batch. It reads orders from its
standard input and exits when that is closed, which also happens when this process is killed.
"""

from __future__ import annotations

import json
import math
import queue
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Protocol

from meshdeform.cli.batches.ledger import Ledger
from meshdeform.cli.batches.rows import Row
from meshdeform.cli.jobs import Deadline, follow, save_artifacts
from meshdeform.errors import (
    AssetError,
    ConflictError,
    LimitError,
    ModelError,
    NotFoundError,
    RequestError,
    TooMuchStoredError,
    UnavailableError,
)
from meshdeform.serving.processes import python_command

if TYPE_CHECKING:
    from meshdeform.api.jobs import EventView, JobView
    from meshdeform.client import Client

__all__ = ["LocalRunner", "RowOutcome", "Runner", "ServiceRunner", "Tick", "do_rows"]


@dataclass(frozen=True)
class Tick:
    """Progress of a row."""

    step: int
    total_steps: int
    loss: float
    eta_s: float | None = None


@dataclass(frozen=True)
class RowOutcome:
    """Outcome of a row.

    Attributes
    ----------
    state : str
        `succeeded`, `failed`, `canceled` or `expired`.
    seconds : float
        Duration of the row.
    job_id : str, optional
        The job, if a service ran it.
    files : dict
        SHA-256 of each file, by name.
    losses : dict
        Losses of the last step.
    error : dict, optional
        `code`, `detail` and `advice`, unless it succeeded.
    """

    state: str
    seconds: float
    job_id: str | None = None
    files: dict[str, str] = field(default_factory=dict)
    losses: dict[str, float] = field(default_factory=dict)
    error: dict[str, Any] | None = None


class Runner(Protocol):
    """Runs rows; called from several threads."""

    def do(self, row: Row, on_tick: Callable[[Tick], None]) -> RowOutcome:
        """Run a row. An exception ends the batch; a problem of this row alone is an outcome."""

    def close(self) -> None:
        """Release all resources at once; running rows stop locally and continue on a service."""


def do_rows(
    rows: Sequence[Row],
    runner: Runner,
    *,
    parallel: int,
    on_start: Callable[[Row], None],
    on_tick: Callable[[Row, Tick], None],
    on_end: Callable[[Row, RowOutcome], None],
) -> None:
    """Run all rows.

    Parameters
    ----------
    rows : sequence of Row
    runner : Runner
    parallel : int
        Maximum number of rows at the same time.
    on_start, on_tick, on_end : callable
        Called in the thread of the caller.

    Raises
    ------
    Exception
        The first exception of the runner; running rows are abandoned.
    """
    todo: queue.SimpleQueue[Row] = queue.SimpleQueue()
    for row in rows:
        todo.put(row)
    calls: queue.SimpleQueue[tuple[Callable[..., None], tuple[Any, ...]] | Exception] = queue.SimpleQueue()
    stop = threading.Event()

    def work() -> None:
        while not stop.is_set():
            try:
                row = todo.get_nowait()
            except queue.Empty:
                return
            calls.put((on_start, (row,)))
            try:
                outcome = runner.do(row, lambda tick, row=row: calls.put((on_tick, (row, tick))))  # type: ignore[misc]
            except Exception as error:  # raised again in the waiting thread
                calls.put(error)
                return
            calls.put((on_end, (row, outcome)))

    for number in range(min(parallel, len(rows))):
        # Daemon threads, so that one that is waiting cannot keep the process alive.
        threading.Thread(target=work, name=f"row {number}", daemon=True).start()
    left = len(rows)
    try:
        while left:
            found = calls.get()
            if isinstance(found, Exception):
                raise found
            call, arguments = found
            left -= call is on_end
            call(*arguments)
    finally:
        stop.set()


_MODULE = "meshdeform.cli.batches.local_process"
_STATES = ".states"
_ERROR_TAIL = 2000


class LocalRunner:
    """Runs rows in processes on this machine.

    Parameters
    ----------
    folder : Path
        The folder of the batch.
    settings : dict
        `device` and `threads` of each process; None: from the environment.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self._folder, self._settings = folder, settings
        self._idle: queue.SimpleQueue[_Process] = queue.SimpleQueue()
        self._all: list[_Process] = []
        self._lock, self._closed = threading.Lock(), False

    def do(self, row: Row, on_tick: Callable[[Tick], None]) -> RowOutcome:
        """Run a row, from its last checkpoint if there is one."""
        start = time.monotonic()
        process = self._process()
        answer = process.ask(self._order(row), on_tick)
        if answer is None:
            error = {
                "code": "worker_lost",
                "detail": process.exit_message(),
                "advice": "The machine may be out of memory.",
            }
            return RowOutcome("failed", round(time.monotonic() - start, 3), error=error)
        self._idle.put(process)
        if answer["event"] == "failed" and answer["error"]["code"] == UnavailableError.code:
            # The results cannot be written, so the next row would fail as well.
            raise UnavailableError(answer["error"]["detail"], advice=answer["error"]["advice"])
        if answer["event"] == "failed":
            return RowOutcome("failed", round(time.monotonic() - start, 3), error=answer["error"])
        return RowOutcome("succeeded", answer["elapsed_s"], files=answer["files"], losses=answer["losses"])

    def close(self) -> None:
        """Kill every process."""
        with self._lock:
            self._closed = True
            for process in self._all:
                process.end()
        states = self._folder / _STATES
        if states.is_dir() and not any(states.iterdir()):
            states.rmdir()

    def _process(self) -> _Process:
        try:
            return self._idle.get_nowait()
        except queue.Empty:
            with self._lock:
                if self._closed:
                    raise RuntimeError("the batch has ended") from None
                self._all = [process for process in self._all if process.alive] + [_Process()]
                return self._all[-1]

    def _order(self, row: Row) -> dict[str, Any]:
        return {
            "asset": str(row.asset),
            "target": str(row.target) if row.target else None,
            "request": row.request.model_dump(mode="json", exclude_unset=True),
            "folder": str(self._folder / row.name),
            "state": str(self._folder / _STATES / row.key),
            "settings": self._settings,
        }


class _Process:
    """A process that runs one row at a time."""

    def __init__(self) -> None:
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `end`
        self._process = subprocess.Popen(
            python_command(_MODULE),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            # Ctrl-C in the terminal must reach only the parent.
            process_group=0,
        )

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self._process.poll() is None

    def ask(self, order: dict[str, Any], on_tick: Callable[[Tick], None]) -> dict[str, Any] | None:
        """Run a row and return the answer; None if the process died."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write((json.dumps(order) + "\n").encode())
            self._process.stdin.flush()
            for line in self._process.stdout:
                answer: dict[str, Any] = json.loads(line)
                if answer["event"] != "step":
                    return answer
                on_tick(Tick(answer["step"], answer["total_steps"], answer["loss"]))
        except (OSError, ValueError):
            self._process.kill()
        self._process.wait()
        return None

    def exit_message(self) -> str:
        """Describe how the process died."""
        self._errors.seek(max(0, self._errors.seek(0, 2) - _ERROR_TAIL))
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return f"The process died with exit code {self._process.returncode}" + (f": {lines[-1]}" if lines else ".")

    def end(self) -> None:
        """Kill the process; outputs are written atomically, so no partial file remains."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout, self._errors):
            if pipe is not None:
                try:
                    pipe.close()
                except OSError:
                    continue


_ENDED = {"failed": "failed", "canceled": "was canceled", "expired": "expired"}
_LIMIT_PAUSE_S = 5.0
_LIMIT_TIMEOUT_S = 3600.0


class ServiceRunner:
    """Runs rows as jobs of a service.

    A row's Idempotency-Key consists of the batch, the row's key and its number of failures. If the process dies between
    the response and the line in the ledger, the next run therefore gets the same job, not a second one.

    Parameters
    ----------
    client : Client
    ledger : Ledger
    folder : Path
    """

    def __init__(self, client: Client, ledger: Ledger, folder: Path) -> None:
        self._client, self._ledger, self._folder = client, ledger, folder
        self._stop = threading.Event()

    def do(self, row: Row, on_tick: Callable[[Tick], None]) -> RowOutcome:
        """Find or submit the row's job, wait for it and fetch its artifacts."""
        start = time.monotonic()
        try:
            job = self._existing_job(row) or self._submit(row)
            if not job.state.terminal:
                job = follow(self._client, job.id, partial(_pass_on, on_tick), deadline=Deadline(None))
            return self._outcome(row, job, start)
        except (AssetError, RequestError, ModelError, NotFoundError, ConflictError) as error:
            # Refused by the service, or deleted meanwhile; other rows can go on.
            refused = {"code": error.code, "detail": error.detail, "advice": error.advice_text}
            return RowOutcome("failed", round(time.monotonic() - start, 3), error=refused)

    def close(self) -> None:
        """Close the connections; jobs continue, and the same command finds them again."""
        self._stop.set()
        self._client.close()

    def _existing_job(self, row: Row) -> JobView | None:
        line = self._ledger.last.get(row.key, {})
        if line.get("event") not in ("submitted", "done") or not line.get("job_id"):
            return None
        try:
            return self._client.get(line["job_id"])
        except NotFoundError:
            # Deleted, or on another service: its Idempotency-Key must not be used again.
            self._ledger.append("failed", row.key, row.name, job_id=line["job_id"], error={"code": "not_found"})
            return None

    def _submit(self, row: Row) -> JobView:
        tries = self._ledger.tries.get(row.key, 0)
        deadline = time.monotonic() + _LIMIT_TIMEOUT_S
        while True:
            try:
                job = self._client.submit(
                    row.asset,
                    row.request.prompt,
                    params=row.request.params,
                    output=row.request.output,
                    target=row.target,
                    metadata={"batch": self._ledger.batch_id, "row": row.name},
                    idempotency_key=f"batch-{self._ledger.batch_id}-{row.key}-{tries}",
                )
            except TooMuchStoredError:
                raise
            except LimitError:
                # Wait until other rows of this batch have ended.
                if time.monotonic() > deadline or self._stop.wait(_LIMIT_PAUSE_S):
                    raise
            else:
                self._ledger.append("submitted", row.key, row.name, job_id=job.id, **{"try": tries})
                return job

    def _outcome(self, row: Row, job: JobView, start: float) -> RowOutcome:
        if job.state.value != "succeeded":
            error = {"code": f"job_{job.state.value}", "detail": f"The job {_ENDED[job.state.value]}.", "advice": ""}
            if job.error is not None:
                error = {"code": job.error.code, "detail": job.error.detail, "advice": job.error.advice}
            return RowOutcome(job.state.value, round(time.monotonic() - start, 3), job.id, error=error)
        files = save_artifacts(self._client, job.id, self._folder / row.name)
        seconds = time.monotonic() - start
        if job.finished_at is not None:
            seconds = (job.finished_at - job.created_at).total_seconds()
        digests = {str(file["name"]): str(file["sha256"]) for file in files}
        return RowOutcome("succeeded", round(seconds, 3), job.id, digests, dict(job.progress.losses))


def _pass_on(on_tick: Callable[[Tick], None], event: EventView) -> None:
    if event.type.value == "progress" and (total := int(event.data.get("total_steps", 0))):
        loss = (event.data.get("losses") or {}).get("total", math.nan)
        on_tick(Tick(int(event.data.get("step", 0)), total, loss, event.data.get("eta_s")))
