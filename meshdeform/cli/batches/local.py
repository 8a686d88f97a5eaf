"""Rows done on this machine, each slot a process of its own: one that dies costs its row and not the batch.

A process keeps the model from row to row. It reads orders from its standard input; when that ends, because this
process has ended however it did, it ends at once.
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
_LAST_WORDS = 2000


class LocalRunner:
    """Rows in processes of this machine.

    Parameters
    ----------
    folder : Path
        The batch's.
    settings : dict
        `device` and `threads` of each process, where they are not those of the environment.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self._folder, self._settings = folder, settings
        self._idle: queue.SimpleQueue[_Process] = queue.SimpleQueue()
        self._all: list[_Process] = []
        self._lock, self._closed = threading.Lock(), False

    def do(self, row: Row, told: Callable[[Tick], None]) -> RowOutcome:
        """Deform; goes on from the row's last checkpoint where there is one."""
        start = time.monotonic()
        process = self._process()
        answer = process.ask(self._order(row), told)
        if answer is None:
            error = {"code": "worker_lost", "detail": process.last_words(), "advice": "Often: out of memory."}
            return RowOutcome("failed", round(time.monotonic() - start, 3), error=error)
        self._idle.put(process)
        if answer["event"] == "failed" and answer["error"]["code"] == UnavailableError.code:
            # There is no place for results: the next row would fail as well.
            raise UnavailableError(answer["error"]["detail"], advice=answer["error"]["advice"])
        if answer["event"] == "failed":
            return RowOutcome("failed", round(time.monotonic() - start, 3), error=answer["error"])
        return RowOutcome("succeeded", answer["elapsed_s"], files=answer["files"], losses=answer["losses"])

    def close(self) -> None:
        """End every process."""
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
                self._all = [process for process in self._all if process.lives] + [_Process()]
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
    """A process that does one row after the other."""

    def __init__(self) -> None:
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `end`
        self._process = subprocess.Popen(
            python_command(_MODULE),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            # Ctrl-C at the terminal is for the parent alone.
            process_group=0,
        )

    @property
    def lives(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    def ask(self, order: dict[str, Any], told: Callable[[Tick], None]) -> dict[str, Any] | None:
        """Do a row; None: the process died."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write((json.dumps(order) + "\n").encode())
            self._process.stdin.flush()
            for line in self._process.stdout:
                answer: dict[str, Any] = json.loads(line)
                if answer["event"] != "step":
                    return answer
                told(Tick(answer["step"], answer["total_steps"], answer["loss"]))
        except (OSError, ValueError):
            self._process.kill()
        self._process.wait()
        return None

    def last_words(self) -> str:
        """How a process ended that should not have."""
        self._errors.seek(max(0, self._errors.seek(0, 2) - _LAST_WORDS))
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return f"The process died with exit code {self._process.returncode}" + (f": {lines[-1]}" if lines else ".")

    def end(self) -> None:
        """Kill it: what it had not written whole is not there."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout, self._errors):
            if pipe is not None:
                try:
                    pipe.close()
                except OSError:
                    continue
