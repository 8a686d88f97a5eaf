"""Run the rows of a batch: in processes of this machine, or as jobs of a service.

A process keeps the model in memory from row to row, and a crash fails one row, not the batch. This module is its
program: it reads orders from its standard input, one JSON a line, answers on standard output, and exits when the input
is closed, which also happens when its parent is killed.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Protocol

from meshdeform.cli.batches.ledger import Ledger
from meshdeform.cli.batches.rows import Row
from meshdeform.cli.jobs import Deadline, follow, outcome_failure, save_artifacts, show_event
from meshdeform.cli.output import ProgressView
from meshdeform.errors import (
    AssetError,
    CheckpointError,
    ConflictError,
    LimitError,
    MeshdeformError,
    ModelError,
    NotFoundError,
    RequestError,
    TooMuchStoredError,
    UnavailableError,
)
from meshdeform.serving.processes import python_command

if TYPE_CHECKING:
    from meshdeform.api.jobs import JobView
    from meshdeform.cli.local import FinishedRun
    from meshdeform.client import Client

_STATES = ".states"
_ERROR_TAIL = 2000
_TICK_EVERY_S = 0.25
_LIMIT_PAUSE_S = 5.0
_LIMIT_TIMEOUT_S = 3600.0


@dataclass(frozen=True)
class RowOutcome:
    """Outcome of a row: `succeeded`, `failed`, `canceled` or `expired`, and after how many seconds.

    `files` has the SHA-256 of each file by name, `losses` those of the last step; `error` has `code`, `detail` and
    `advice` unless it succeeded.
    """

    state: str
    seconds: float
    job_id: str | None = None
    files: dict[str, str] = field(default_factory=dict)
    losses: dict[str, float] = field(default_factory=dict)
    error: dict[str, Any] | None = None


def _error(code: str, detail: str, advice: str) -> dict[str, str]:
    return {"code": code, "detail": detail, "advice": advice}


def _failed(start: float, error: dict[str, str]) -> RowOutcome:
    return RowOutcome("failed", round(time.monotonic() - start, 3), error=error)


class Runner(Protocol):
    """Runs rows; called from several threads."""

    def do(self, row: Row, progress: ProgressView) -> RowOutcome:
        """Run a row. An exception ends the batch; a problem of this row alone is an outcome."""

    def close(self) -> None:
        """Release all resources at once; running rows stop locally and continue on a service."""


class LocalRunner:
    """Runs rows in processes on this machine, with a `device` and `threads` each; None: from the environment."""

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self._folder, self._settings = folder, settings
        self._idle: queue.SimpleQueue[_Process] = queue.SimpleQueue()
        self._all: list[_Process] = []
        self._lock, self._closed = threading.Lock(), False

    def do(self, row: Row, progress: ProgressView) -> RowOutcome:
        """Run a row, from its last checkpoint if there is one."""
        start = time.monotonic()
        process = self._process()
        answer = process.ask(self._order(row), progress)
        if answer is None:
            error = _error("worker_lost", process.exit_message(), "The machine may be out of memory.")
            return _failed(start, error)
        self._idle.put(process)
        if answer["event"] == "failed":
            error = answer["error"]
            if error["code"] == UnavailableError.code:  # no result can be written: the next row would fail as well
                raise UnavailableError(error["detail"], advice=error["advice"])
            return _failed(start, error)
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
            "files": {field: str(path) for field, path in (("asset", row.asset), ("target", row.target)) if path},
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
            python_command(__name__),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            # Ctrl-C in the terminal must reach only the parent.
            process_group=0,
        )

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def ask(self, order: dict[str, Any], progress: ProgressView) -> dict[str, Any] | None:
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
                progress.step(answer["step"], answer["total_steps"], answer["loss"])
        except (OSError, ValueError):
            self._process.kill()
        self._process.wait()
        return None

    def exit_message(self) -> str:
        """Say how the process died."""
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


class ServiceRunner:
    """Runs rows as jobs of a service.

    A row's Idempotency-Key consists of the batch, the row's key and its number of failures. If the process dies between
    the response and the line in the ledger, the next run therefore gets the same job, not a second one.
    """

    def __init__(self, client: Client, ledger: Ledger, folder: Path) -> None:
        self._client, self._ledger, self._folder = client, ledger, folder
        self._stop = threading.Event()

    def do(self, row: Row, progress: ProgressView) -> RowOutcome:
        """Find or submit the row's job, wait for it and fetch its artifacts."""
        start = time.monotonic()
        try:
            job = self._existing_job(row) or self._submit(row)
            if not job.state.terminal:
                shown = functools.partial(show_event, view=progress)
                job = follow(self._client, job.id, shown, deadline=Deadline(None))
            return self._outcome(row, job, start)
        except (AssetError, RequestError, ModelError, NotFoundError, ConflictError) as error:
            # Refused by the service, or deleted meanwhile; other rows can go on.
            return _failed(start, _error(error.code, error.detail, error.advice_text))

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
        seconds = time.monotonic() - start
        if (failure := outcome_failure(job)) is not None:
            error = _error(failure.name, failure.detail, failure.advice)
            return RowOutcome(job.state.value, round(seconds, 3), job.id, error=error)
        saved = save_artifacts(self._client, job.id, self._folder / row.name)
        seconds = time.monotonic() - start
        if job.finished_at is not None:
            seconds = (job.finished_at - job.created_at).total_seconds()
        digests = {str(file["name"]): str(file["sha256"]) for file in saved}
        return RowOutcome("succeeded", round(seconds, 3), job.id, digests, dict(job.progress.losses))


class _Ticks(ProgressView):
    """Passes on steps to the parent, at most four per second."""

    def __init__(self, answers: IO[str]) -> None:
        self._answers, self._last = answers, 0.0

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:  # noqa: ARG002
        now = time.monotonic()
        if step == total_steps or now - self._last >= _TICK_EVERY_S:
            self._last = now
            tick = {"event": "step", "step": step, "total_steps": total_steps, "loss": loss}
            print(json.dumps(tick), file=self._answers, flush=True)


def main() -> None:
    """Process orders until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Keep what libraries print out of the answers.
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    orders: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(orders,), name="orders", daemon=True).start()
    while True:
        order = orders.get()
        try:
            done = _do(order, _Ticks(answers))
        except MeshdeformError as error:
            done = {"event": "failed", "error": _error(error.code, error.detail, error.advice_text)}
        except Exception as error:  # a bug fails its row and is reported
            traceback.print_exc()
            done = {"event": "failed", "error": _error("internal", f"{type(error).__name__}: {error}", "Report this.")}
        print(json.dumps(done), file=answers, flush=True)


def _read(orders: queue.SimpleQueue[dict[str, Any]]) -> None:
    for line in sys.stdin:
        orders.put(json.loads(line))
    # The parent has ended, perhaps during a row, and nothing can record a result.
    os._exit(0)


def _do(order: dict[str, Any], ticks: _Ticks) -> dict[str, Any]:
    from meshdeform.cli.environment import load_settings
    from meshdeform.cli.local import LocalJob
    from meshdeform.requests.document import JobRequest

    folder, state = Path(order["folder"]), Path(order["state"])
    request, settings = JobRequest.model_validate(order["request"]), load_settings(**order["settings"])
    names = ["result.glb", "report.json", "preview.png", *(["morph.glb"] if request.output.morph else [])]
    files = {field: Path(path) for field, path in order["files"].items()}

    def run(resume: Path | None) -> FinishedRun:
        outputs = {name: folder / name for name in names}
        job = LocalJob(request, files, outputs, settings, checkpoint=state, resume=resume, load=_prior_loader())
        return job.run(ticks)

    try:
        finished = run(state if state.exists() else None)
    except CheckpointError:
        # The checkpoint is damaged or of another version: start over.
        state.unlink(missing_ok=True)
        finished = run(None)
    state.unlink(missing_ok=True)
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in finished.artifacts.items()}
    return {"event": "done", "elapsed_s": finished.elapsed_s, "losses": finished.losses, "files": digests}


@functools.cache
def _prior_loader() -> Any:
    from meshdeform.priors import load_prior

    return functools.lru_cache(maxsize=1)(load_prior)


if __name__ == "__main__":
    main()
