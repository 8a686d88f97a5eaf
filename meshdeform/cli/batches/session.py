"""One run of a batch: select the rows to do, run and show them, and write the summary, also after Ctrl-C."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from meshdeform.cli.batches.ledger import Ledger
from meshdeform.cli.batches.rows import ARTIFACTS, Row
from meshdeform.cli.batches.runners import RowOutcome, Runner
from meshdeform.cli.batches.summary import count_states, record_of, write_summary
from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.cli.local import writing
from meshdeform.cli.output import BatchView, ProgressView, duration, emit, note, show_batch
from meshdeform.errors import UnavailableError

__all__ = ["Session"]


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
