"""Rows over several threads: each takes the next row to a runner; what became of it is written down before the next."""

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
    """How far a row is."""

    step: int
    total_steps: int
    loss: float
    eta_s: float | None = None


@dataclass(frozen=True)
class RowOutcome:
    """What became of a row.

    Attributes
    ----------
    state : str
        `succeeded`, `failed`, `canceled` or `expired`.
    seconds : float
        From its beginning here to its end.
    job_id : str, optional
        Where a service did it.
    files : dict
        SHA-256 of each file, by name.
    losses : dict
        Of the last step.
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
    """Who does rows; several threads call it."""

    def do(self, row: Row, told: Callable[[Tick], None]) -> RowOutcome:
        """Do a row. An exception ends the batch; what is wrong with the row alone is an outcome."""

    def close(self) -> None:
        """Let go of everything, at once; rows that are being done stop, or go on elsewhere."""


def do_rows(
    rows: Sequence[Row],
    runner: Runner,
    *,
    parallel: int,
    on_start: Callable[[Row], None],
    on_tick: Callable[[Row, Tick], None],
    on_end: Callable[[Row, RowOutcome], None],
) -> None:
    """Do all rows.

    Parameters
    ----------
    rows : sequence of Row
    runner : Runner
    parallel : int
        Rows at the same time.
    on_start, on_tick, on_end : callable
        Called in this thread.

    Raises
    ------
    Exception
        The first that the runner raised; rows that are being done are left.
    """
    todo: queue.SimpleQueue[Row] = queue.SimpleQueue()
    for row in rows:
        todo.put(row)
    told: queue.SimpleQueue[tuple[Callable[..., None], tuple[Any, ...]] | Exception] = queue.SimpleQueue()
    stop = threading.Event()

    def work() -> None:
        while not stop.is_set():
            try:
                row = todo.get_nowait()
            except queue.Empty:
                return
            told.put((on_start, (row,)))
            try:
                outcome = runner.do(row, lambda tick, row=row: told.put((on_tick, (row, tick))))  # type: ignore[misc]
            except Exception as error:  # it belongs to the thread that waits
                told.put(error)
                return
            told.put((on_end, (row, outcome)))

    for number in range(min(parallel, len(rows))):
        # Daemons: one that waits for an answer must not hold a process that was told to end.
        threading.Thread(target=work, name=f"row {number}", daemon=True).start()
    left = len(rows)
    try:
        while left:
            found = told.get()
            if isinstance(found, Exception):
                raise found
            call, arguments = found
            left -= call is on_end
            call(*arguments)
    finally:
        stop.set()
