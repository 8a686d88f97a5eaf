"""One run of a batch: select the rows to do, run and show them, and write the summary, also after Ctrl-C."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

from meshdeform.cli.batches.ledger import Ledger
from meshdeform.cli.batches.rows import ARTIFACTS, Row
from meshdeform.cli.batches.runners import RowOutcome, Runner, Tick, do_rows
from meshdeform.cli.batches.summary import count_states, record_of, write_summary
from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.cli.local import writing
from meshdeform.cli.output import duration, emit, note, plain
from meshdeform.cli.progress import LINE_EVERY_S, Pace, StepBars, is_terminal
from meshdeform.errors import UnavailableError

if TYPE_CHECKING:
    from rich.progress import TaskID

__all__ = ["BatchView", "Session", "show_batch"]


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


class Session:
    """The folder of a batch while this process works on it. A context manager.

    Parameters
    ----------
    folder : Path
    as_json : bool
        Whether to print a line on standard output for each row that ends.
    quiet : bool
    flat : bool
        Whether all results are files in the folder itself.
    """

    def __init__(self, folder: Path, *, as_json: bool, quiet: bool, flat: bool = False) -> None:
        self.folder, self._as_json, self._quiet = folder, as_json, quiet
        self.ledger = Ledger(folder, flat=flat)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.ledger.__exit__(kind, error, trace)

    def left(self, rows: Sequence[Row], *, retry_failed: bool) -> list[Row]:
        """Return the rows that are not done or have lost their result; failed ones only with `retry_failed`."""
        return [row for row in rows if self._is_left(row, retry_failed=retry_failed)]

    def run(self, rows: Sequence[Row], runner: Runner, parallel: int, *, retry_failed: bool) -> None:
        """Run the rows that are left.

        Raises
        ------
        OutcomeError
            Ctrl-C came; the summary is written.
        MeshdeformError
            The batch cannot continue: the service or the disk is unavailable.
        """
        todo = self.left(rows, retry_failed=retry_failed)
        for row in todo:
            if row.flat and row.key not in self.ledger.last:
                # So that a file of an interrupted run does not look like somebody else's.
                self.ledger.append("named", row.key, row.name)
        if len(todo) < len(rows):
            note(f"{len(rows) - len(todo)} of {len(rows)} rows are finished already.", quiet=self._quiet)
        try:
            with show_batch(len(rows), len(rows) - len(todo), quiet=self._quiet) as view:
                do_rows(
                    todo,
                    runner,
                    parallel=parallel,
                    on_start=view.start,
                    on_tick=view.tick,
                    on_end=lambda row, outcome: self._end(row, outcome, view),
                )
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
        """Write the summary; return the number of rows in each state and the paths of the files.

        Raises
        ------
        UnavailableError
            The files cannot be written.
        """
        records = [record_of(row, self.ledger.last.get(row.key), self.folder) for row in rows]
        pictures = [row.path(self.folder, "preview.png") for row in rows]
        with writing("The summary", "Free some space, then run the same command again."):
            files = write_summary(self.folder, self.ledger.batch_id, records, pictures)
        return count_states(records), files

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
        if outcome.state == "succeeded":
            if row.flat:
                self._flatten(row)
            self.ledger.append("done", row.key, row.name, files=outcome.files, **more)
        else:
            self.ledger.append("failed", row.key, row.name, error=outcome.error, **more)
        view.end(row, outcome)
        if self._as_json:
            emit({"event": "row", **record_of(row, self.ledger.last[row.key], self.folder)})
