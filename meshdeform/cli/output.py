"""Print results on standard output, and everything about progress on standard error.

Progress is a bar on a terminal; elsewhere a line every few seconds for logs, without control characters.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

from meshdeform.errors import readable_size

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from meshdeform.client import UploadProgress

_MINUTE, _HOUR, _DAY = 60, 3600, 86_400
_LINE_EVERY_S = 5.0


def emit(document: Any) -> None:
    """Print a JSON document as one line and flush it, so that a reader of the pipe gets it at once."""
    typer.echo(json.dumps(document))


def note(text: str, *, quiet: bool = False) -> None:
    """Print a note about progress on standard error, unless `quiet`."""
    if not quiet:
        typer.echo(plain(text), err=True)


def plain(text: str) -> str:
    """Return the text without control characters, so that no prompt or name can control the terminal."""
    return "".join(letter for letter in text if letter in "\n\t" or unicodedata.category(letter) not in ("Cc", "Cf"))


def duration(seconds: float) -> str:
    """Format seconds for people: `8 s`, `2 min 05 s`, `1 h 20 min`."""
    whole = max(0, round(seconds))
    if whole < _MINUTE:
        return f"{whole} s"
    if whole < _HOUR:
        return f"{whole // _MINUTE} min {whole % _MINUTE:02} s"
    return f"{whole // _HOUR} h {whole % _HOUR // _MINUTE:02} min"


def ago(seconds: float) -> str:
    """Format an age in seconds in its largest unit: `3 min ago`."""
    for size, unit in ((_DAY, "d"), (_HOUR, "h"), (_MINUTE, "min")):
        if seconds >= size:
            return f"{int(seconds // size)} {unit} ago"
    return f"{max(0, int(seconds))} s ago"


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return columns of text aligned with spaces; the last column is not padded."""
    lines = [titles, *([plain(cell).replace("\n", " ") for cell in row] for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(titles))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )


class ProgressView:
    """Receives the progress of a job, and shows nothing."""

    def phase(self, name: str) -> None:
        """Show that a phase has begun."""

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:
        """Show that a step is done; `eta_s` is the time left in seconds, estimated from the pace if None."""


def _is_terminal() -> bool:
    """Return whether standard error is a terminal that can move its cursor."""
    return sys.stderr.isatty() and os.environ.get("TERM", "") != "dumb"


class Pace:
    """Estimate the time left from the times of the steps so far, by a clock of seconds; the newest weigh most."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._last: tuple[int, float] | None = None
        self._step_s: float | None = None

    def eta_s(self, step: int, total_steps: int) -> float | None:
        """Return the seconds left after `step`; None for the first one."""
        now = self._clock()
        if self._last is not None and step > self._last[0]:
            step_s = (now - self._last[1]) / (step - self._last[0])
            self._step_s = step_s if self._step_s is None else 0.9 * self._step_s + 0.1 * step_s
        if self._last is None or step != self._last[0]:
            self._last = (step, now)
        return None if self._step_s is None else max(0, total_steps - step) * self._step_s


class _Bars:
    """Bars on a terminal, one for each job: phase or name, steps, loss, time left."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        # rich would look at standard output, which may be a pipe.
        self.progress: Progress = Progress(
            TextColumn("{task.description:<11}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[note]}", markup=False),
            console=Console(stderr=True, force_terminal=True),
            transient=True,
        )

    def add(self, name: str) -> TaskID:
        """Add a bar of unknown length."""
        return self.progress.add_task(plain(name), total=None, note="")


class _JobProgress(ProgressView):
    def __init__(self, bars: _Bars | None) -> None:
        self._bars, self._task = bars, bars.add("starting") if bars else None
        self._pace, self._phase, self._last = Pace(), "", time.monotonic()

    def phase(self, name: str) -> None:
        if self._bars is not None and self._task is not None:
            self._bars.progress.update(self._task, description=plain(name))
        elif name != self._phase:
            self._phase = name
            note(name)

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:
        left, now = self._pace.eta_s(step, total_steps) if eta_s is None else eta_s, time.monotonic()
        if self._bars is not None and self._task is not None:
            self._bars.progress.update(self._task, completed=step, total=total_steps, note=_facts(loss, left))
        elif step == total_steps or now - self._last >= _LINE_EVERY_S:
            self._last = now
            note(f"step {step}/{total_steps}  {_facts(loss, None if step == total_steps else left)}".rstrip())


class BatchView:
    """Shows the rows of a batch by their names, several at the same time, and how many of all have ended."""

    def __init__(self, total: int, done: int, bars: _Bars | None, *, quiet: bool) -> None:
        self._total, self._done, self._failed, self._quiet = total, done, 0, quiet
        self._bars = bars
        self._tasks: dict[str, TaskID] = {}
        self._pace, self._last = Pace(), time.monotonic()
        if bars is not None:
            self._whole = bars.add("rows")
            self._show(bars)

    def start(self, name: str) -> None:
        """Show that a row has begun."""
        if self._bars is not None:
            self._tasks[name] = self._bars.add(name[:40])

    def step(self, name: str, step: int, total_steps: int, loss: float) -> None:
        """Show that a step of a row is done."""
        now = time.monotonic()
        if self._bars is not None:
            self._bars.progress.update(self._tasks[name], completed=step, total=total_steps, note=_facts(loss, None))
        elif now - self._last >= _LINE_EVERY_S:
            self._last = now
            note(f"{self._done}/{self._total} done; {name}: step {step}/{total_steps}", quiet=self._quiet)

    def end(self, name: str, line: str, *, failed: bool) -> None:
        """Show that a row has ended, by a line about it."""
        self._done, self._failed, self._last = self._done + 1, self._failed + failed, time.monotonic()
        if self._bars is None:
            note(f"{self._done}/{self._total}  {line}", quiet=self._quiet)
            return
        self._bars.progress.remove_task(self._tasks.pop(name))
        self._bars.progress.console.print(plain(line), markup=False, highlight=False)
        self._show(self._bars)

    def _show(self, bars: _Bars) -> None:
        left = self._pace.eta_s(self._done, self._total)
        notes = [f"{self._failed} failed" if self._failed else "", f"{duration(left)} left" if left else ""]
        bars.progress.update(self._whole, completed=self._done, total=self._total, note="  ".join(filter(None, notes)))


def _facts(loss: float, eta_s: float | None) -> str:
    shown = "" if math.isnan(loss) else f"loss {loss:.4g}"
    return f"{shown}  {duration(eta_s)} left".strip() if eta_s is not None else shown


@contextmanager
def _shown_bars(*, quiet: bool) -> Iterator[_Bars | None]:
    if quiet or not _is_terminal():
        yield None
        return
    bars = _Bars()
    with bars.progress:
        yield bars


@contextmanager
def show_progress(*, quiet: bool = False) -> Iterator[ProgressView]:
    """Yield a view of a job: a bar if standard error is a terminal, else lines; with `quiet`, nothing."""
    with _shown_bars(quiet=quiet) as bars:
        yield ProgressView() if quiet else _JobProgress(bars)


@contextmanager
def show_uploads(*, quiet: bool = False) -> Iterator[Callable[[UploadProgress], None]]:
    """Yield what a client calls with the progress of its uploads: a bar for each file, without a terminal a line."""
    with _shown_bars(quiet=quiet) as bars:
        tasks: dict[str, TaskID] = {}
        told: set[str] = set()

        def show(progress: UploadProgress) -> None:
            name, (sent, size) = progress.filename, (math.ceil(n / 1024) for n in progress[1:])
            if bars is not None:
                if name not in tasks:
                    tasks[name] = bars.add("sending")
                bars.progress.update(tasks[name], completed=sent, total=size, note=f"KiB of {plain(name)}")
            elif name not in told:
                note(f"sending {name}, {readable_size(progress.size)}", quiet=quiet)
            told.add(name)

        yield show


@contextmanager
def show_batch(total: int, done: int, *, quiet: bool) -> Iterator[BatchView]:
    """Yield a view of a batch of `total` rows, of which some were done earlier."""
    with _shown_bars(quiet=quiet) as bars:
        yield BatchView(total, done, bars, quiet=quiet)
