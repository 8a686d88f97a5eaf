"""Show the progress of a batch: bars on a terminal, elsewhere a line for each row."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from meshdeform.cli.batches.rows import Row
from meshdeform.cli.batches.work import RowOutcome, Tick
from meshdeform.cli.output import duration, note, plain
from meshdeform.cli.progress import LINE_EVERY_S, Pace, StepBars, is_terminal

if TYPE_CHECKING:
    from rich.progress import TaskID

__all__ = ["BatchView", "show_batch"]


class BatchView(Protocol):
    """Receives the progress of a batch."""

    def start(self, row: Row) -> None:
        """Show that a row has begun."""

    def tick(self, row: Row, tick: Tick) -> None:
        """Show the progress of a row."""

    def end(self, row: Row, outcome: RowOutcome) -> None:
        """Show that a row has ended."""


class _NoProgress:
    def start(self, row: Row) -> None:
        """Show nothing."""

    def tick(self, row: Row, tick: Tick) -> None:
        """Show nothing."""

    def end(self, row: Row, outcome: RowOutcome) -> None:
        """Show nothing."""


class _Lines:
    def __init__(self, total: int, done: int) -> None:
        self._total, self._done, self._last = total, done, time.monotonic()

    def start(self, row: Row) -> None:
        """Show nothing until the row ends."""

    def tick(self, row: Row, tick: Tick) -> None:
        now = time.monotonic()
        if now - self._last >= LINE_EVERY_S:
            self._last = now
            note(f"{self._done}/{self._total} done; {row.name}: step {tick.step}/{tick.total_steps}")

    def end(self, row: Row, outcome: RowOutcome) -> None:
        self._done, self._last = self._done + 1, time.monotonic()
        note(f"{self._done}/{self._total}  {_ended_line(row, outcome)}")


class _Bars:
    def __init__(self, bars: StepBars, total: int, done: int) -> None:
        self._progress, self._bars, self._pace = bars.progress, bars, Pace()
        self._tasks: dict[str, TaskID] = {}
        self._done, self._failed, self._total = done, 0, total
        self._whole = bars.add("rows")
        self._show()

    def _show(self) -> None:
        left = self._pace.eta_s(self._done, self._total)
        notes = [f"{self._failed} failed" if self._failed else "", f"{duration(left)} left" if left else ""]
        self._progress.update(self._whole, completed=self._done, total=self._total, note="  ".join(filter(None, notes)))

    def start(self, row: Row) -> None:
        self._tasks[row.key] = self._bars.add(row.name[:40])

    def tick(self, row: Row, tick: Tick) -> None:
        loss = "" if math.isnan(tick.loss) else f"loss {tick.loss:.4f}"
        self._progress.update(self._tasks[row.key], completed=tick.step, total=tick.total_steps, note=loss)

    def end(self, row: Row, outcome: RowOutcome) -> None:
        self._progress.remove_task(self._tasks.pop(row.key))
        self._done, self._failed = self._done + 1, self._failed + (outcome.state != "succeeded")
        self._progress.console.print(plain(_ended_line(row, outcome)), markup=False, highlight=False)
        self._show()


def _ended_line(row: Row, outcome: RowOutcome) -> str:
    reason = f": {outcome.error['detail']}" if outcome.error else ""
    return f"{row.name}  {outcome.state}  {duration(outcome.seconds)}{reason}"


@contextmanager
def show_batch(total: int, done: int, *, quiet: bool) -> Iterator[BatchView]:
    """Yield a view.

    Parameters
    ----------
    total, done : int
        Number of rows in the batch, and of those finished earlier.
    quiet : bool
        Whether to show nothing.
    """
    if quiet:
        yield _NoProgress()
    elif not is_terminal():
        yield _Lines(total, done)
    else:
        bars = StepBars()
        with bars.progress:
            yield _Bars(bars, total, done)
