"""One run of a batch: select the rows to do, run and show them, and write the summary, also after Ctrl-C."""

from __future__ import annotations

import fcntl
import json
import os
import queue
import threading
import uuid
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from meshdeform.cli.batches.rows import ARTIFACTS, Row
from meshdeform.cli.batches.runners import RowOutcome, Runner
from meshdeform.cli.batches.summary import count_states, record_of, write_summary
from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.cli.local import writing
from meshdeform.cli.output import duration, emit, note
from meshdeform.cli.progress import BatchView, ProgressView, show_batch
from meshdeform.errors import ParameterError, UnavailableError

__all__ = ["Ledger", "Session"]

_NAME = "ledger.jsonl"
_VERSION = 1


class Ledger:
    """The states of a batch's rows: JSON lines in an append-only file, each on disk before anything relies on it.

    ::

        {"ledger": 1, "batch": ID, "created_at": ..., "flat": false}
        {"event": "named", "key": KEY, "name": NAME}
        {"event": "submitted", "key": KEY, "name": NAME, "job_id": ..., "try": 0}
        {"event": "done", "key": KEY, "name": NAME, "seconds": ..., "files": {...}}
        {"event": "failed", "key": KEY, "name": NAME, "error": {...}}

    `last` has the newest line of each key, `tries` how many `failed` lines each has. An incomplete last line, left by a
    process that was killed, is removed. The file is locked: one process at a time. Thread-safe; a context manager.
    """

    def __init__(self, folder: Path, *, flat: bool = False) -> None:
        self.path = folder / _NAME
        self.flat = flat
        self.last: dict[str, dict[str, Any]] = {}
        self.tries: dict[str, int] = {}
        self.batch_id = ""
        self._lock = threading.Lock()
        with writing(self.path, "Choose another folder with -o."):
            folder.mkdir(parents=True, exist_ok=True)
            self._fd = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        try:
            self._lock_file()
            self._read()
        except BaseException:
            os.close(self._fd)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._fd)

    def append(self, event: str, key: str, name: str, **more: Any) -> None:
        """Add a line; it is on disk when this returns."""
        self._write({"event": event, "key": key, "name": name, "at": _now(), **more})

    def known_names(self) -> dict[str, str]:
        """Return the names of rows by key."""
        return {key: line["name"] for key, line in self.last.items()}

    def _lock_file(self) -> None:
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UnavailableError(
                f"Another `meshdeform batch` is using {self.path.parent}.",
                advice="Wait until it has ended, or choose another folder with -o.",
            ) from None

    def _read(self) -> None:
        data = self.path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            os.ftruncate(self._fd, len(whole))
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                document = json.loads(line)
                self._note(document)
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise ParameterError(
                    f"{self.path}, line {number}, is not a line of a ledger.",
                    advice="Remove the line, or choose another folder with -o.",
                ) from error
        if not self.batch_id:
            self._write({"ledger": _VERSION, "batch": uuid.uuid4().hex, "created_at": _now(), "flat": self.flat})
            _sync_folder(self.path.parent)

    def _note(self, document: dict[str, Any]) -> None:
        if not self.batch_id:
            if document["ledger"] != _VERSION:
                raise ValueError(document["ledger"])
            self.batch_id = str(document["batch"])
            started = bool(document.get("flat", False))
            if started != self.flat:
                raise ParameterError(
                    f"The batch in {self.path.parent} was started {'with' if started else 'without'} --flat.",
                    advice=f"{'Add' if started else 'Leave out'} --flat, or choose another folder with -o.",
                )
            return
        key = document["key"]
        self.last[key] = document
        if document["event"] == "failed":
            self.tries[key] = self.tries.get(key, 0) + 1

    def _write(self, document: dict[str, Any]) -> None:
        line = (json.dumps(document) + "\n").encode()
        with self._lock:
            with writing(self.path, "Free some space; the same command then resumes."):
                while line:
                    line = line[os.write(self._fd, line) :]
                os.fsync(self._fd)
            self._note(document)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class _RowProgress(ProgressView):
    """Passes the steps of a row on to the thread that shows them."""

    def __init__(self, row: Row, steps: Callable[..., None]) -> None:
        self._row, self._steps = row, steps

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:  # noqa: ARG002
        self._steps(self._row.name, step, total_steps, loss)


class Session:
    """One run of a batch. With `as_json`, each row that ends is a line on standard output."""

    def __init__(self, ledger: Ledger, *, as_json: bool, quiet: bool) -> None:
        self.ledger, self.folder, self._as_json, self._quiet = ledger, ledger.path.parent, as_json, quiet

    def run(self, rows: Sequence[Row], runner: Runner, parallel: int, *, retry_failed: bool) -> None:
        """Run the rows that are not done or have lost their result, failed ones only with `retry_failed`.

        An OutcomeError tells of a Ctrl-C, with the summary written; another error that the batch cannot continue, since
        the service or the disk is unavailable.
        """
        todo = [row for row in rows if self._is_left(row, retry_failed=retry_failed)]
        for row in todo:
            if row.flat and row.key not in self.ledger.last:
                # So that a file of an interrupted run does not look like somebody else's.
                self.ledger.append("named", row.key, row.name)
        if len(todo) < len(rows):
            note(f"{len(rows) - len(todo)} of {len(rows)} rows are finished already.", quiet=self._quiet)
        try:
            with show_batch(len(rows), len(rows) - len(todo), quiet=self._quiet) as view:
                self._run(todo, runner, parallel, view)
        except KeyboardInterrupt:
            counts, _ = self.finish(rows)
            raise OutcomeError(
                ExitCode.INTERRUPTED,
                "interrupted",
                f"Interrupted: {counts['succeeded']} of {counts['rows']} rows are done.",
                "Run the same command to do the rest.",
                **counts,
            ) from None
        finally:
            runner.close()

    def finish(self, rows: Sequence[Row]) -> tuple[dict[str, int], dict[str, str]]:
        """Write the summary; return the number of rows in each state and the paths of the files."""
        records = [record_of(row, self.ledger.last.get(row.key), self.folder) for row in rows]
        pictures = [row.path(self.folder, "preview.png") for row in rows]
        with writing("The summary", "Free some space, then run the same command again."):
            files = write_summary(self.folder, self.ledger.batch_id, records, pictures)
        return count_states(records), files

    def _run(self, rows: Sequence[Row], runner: Runner, parallel: int, view: BatchView) -> None:
        """Run rows in threads, up to `parallel` at a time; show and record them in this thread.

        The first exception of the runner ends the batch; running rows are abandoned.
        """
        todo: queue.SimpleQueue[Row] = queue.SimpleQueue()
        for row in rows:
            todo.put(row)
        calls: queue.SimpleQueue[Callable[[], None] | Exception] = queue.SimpleQueue()
        stop = threading.Event()

        def show_step(*step: Any) -> None:
            calls.put(partial(view.step, *step))

        def work() -> None:
            while not stop.is_set():
                try:
                    row = todo.get_nowait()
                except queue.Empty:
                    return
                calls.put(partial(view.start, row.name))
                try:
                    outcome = runner.do(row, _RowProgress(row, show_step))
                except Exception as error:  # raised again in the waiting thread
                    calls.put(error)
                    return
                calls.put(partial(end, row, outcome))

        left = len(rows)

        def end(row: Row, outcome: RowOutcome) -> None:
            nonlocal left
            left -= 1
            self._end(row, outcome, view)

        for number in range(min(parallel, len(rows))):
            # Daemon threads, so that one that is waiting cannot keep the process alive.
            threading.Thread(target=work, name=f"row {number}", daemon=True).start()
        try:
            while left:
                call = calls.get()
                if isinstance(call, Exception):
                    raise call
                call()
        finally:
            stop.set()

    def _is_left(self, row: Row, *, retry_failed: bool) -> bool:
        line = self.ledger.last.get(row.key, {})
        if line.get("event") == "failed":
            return retry_failed
        return line.get("event") != "done" or not row.path(self.folder, "result.glb").exists()

    def _flatten(self, row: Row) -> None:
        """Move the files of a row out of the folder in which they were written."""
        folder = self.folder / row.name
        try:
            for artifact in ARTIFACTS:
                if (folder / artifact).exists():
                    (folder / artifact).replace(row.path(self.folder, artifact))
            folder.rmdir()
        except OSError as error:
            raise UnavailableError(
                f"The results in {folder} cannot be moved: {error}.", advice="Run the same command again."
            ) from error

    def _end(self, row: Row, outcome: RowOutcome, view: BatchView) -> None:
        more: dict[str, Any] = {"state": outcome.state, "seconds": outcome.seconds, "losses": outcome.losses}
        if outcome.job_id is not None:
            more["job_id"] = outcome.job_id
        succeeded = outcome.state == "succeeded"
        if succeeded and row.flat:
            self._flatten(row)
        ending = {"files": outcome.files} if succeeded else {"error": outcome.error}
        self.ledger.append("done" if succeeded else "failed", row.key, row.name, **ending, **more)
        reason = f": {outcome.error['detail']}" if outcome.error else ""
        line = f"{row.name}  {outcome.state}  {duration(outcome.seconds)}{reason}"
        view.end(row.name, line, failed=not succeeded)
        if self._as_json:
            emit({"event": "row", **record_of(row, self.ledger.last[row.key], self.folder)})
