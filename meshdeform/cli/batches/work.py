"""Run rows in several threads and report each outcome to the calling thread."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from meshdeform.cli.batches.rows import Row

__all__ = ["RowOutcome", "Runner", "Tick", "do_rows"]


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
