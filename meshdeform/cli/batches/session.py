"""One run of a batch: select the rows to do, run them, and write the summary, also after Ctrl-C."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from meshdeform.cli.batches.display import BatchView, show_batch
from meshdeform.cli.batches.ledger import Ledger
from meshdeform.cli.batches.rows import ARTIFACTS, Row
from meshdeform.cli.batches.summary import count_states, record_of, write_summary
from meshdeform.cli.batches.work import RowOutcome, Runner, do_rows
from meshdeform.cli.exits import ExitCode, OutcomeError
from meshdeform.cli.output import emit, note
from meshdeform.errors import UnavailableError

__all__ = ["Session"]


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
        try:
            files = write_summary(self.folder, self.ledger.batch_id, records, pictures)
        except OSError as error:
            raise UnavailableError(
                f"The summary cannot be written: {error}.", advice="Free some space, then run the same command again."
            ) from error
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
