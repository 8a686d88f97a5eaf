"""Run rows on this machine, in separate processes: a crash fails one row, not the batch.

A process keeps the model in memory from row to row. It reads orders from its standard input and exits when that is
closed, which also happens when this process is killed.
"""

from __future__ import annotations

import json
import queue
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from meshdeform.cli.batches.rows import Row
from meshdeform.cli.batches.work import RowOutcome, Tick
from meshdeform.errors import UnavailableError
from meshdeform.serving.processes import python_command

__all__ = ["LocalRunner"]

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
