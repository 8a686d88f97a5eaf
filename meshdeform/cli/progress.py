"""Show progress on standard error: a bar on a terminal, elsewhere a line every few seconds.

The lines are for logs: they have no control characters.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

import typer

from meshdeform.cli.output import duration, plain

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

__all__ = ["Pace", "ProgressView", "StepBars", "is_terminal", "show_progress"]

LINE_EVERY_S = 5.0


class ProgressView(Protocol):
    """Receives the progress of a job."""

    def phase(self, name: str) -> None:
        """Show that a phase has begun."""

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:
        """Show that a step is done; `eta_s` is the time left in seconds, estimated from the pace if None."""


def is_terminal() -> bool:
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


class StepBars:
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


class _Bar:
    def __init__(self, bars: StepBars) -> None:
        self._progress, self._task, self._pace = bars.progress, bars.add("starting"), Pace()

    def phase(self, name: str) -> None:
        self._progress.update(self._task, description=plain(name))

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:
        left = self._pace.eta_s(step, total_steps) if eta_s is None else eta_s
        self._progress.update(self._task, completed=step, total=total_steps, note=_facts(loss, left))


class _Lines:
    def __init__(self) -> None:
        self._last, self._pace, self._phase = time.monotonic(), Pace(), ""

    def phase(self, name: str) -> None:
        if name != self._phase:
            self._phase = name
            typer.echo(plain(name), err=True)

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:
        left = self._pace.eta_s(step, total_steps) if eta_s is None else eta_s
        now = time.monotonic()
        if step == total_steps or now - self._last >= LINE_EVERY_S:
            self._last = now
            line = f"step {step}/{total_steps}  {_facts(loss, None if step == total_steps else left)}"
            typer.echo(line.rstrip(), err=True)


class _NoProgress:
    def phase(self, name: str) -> None:
        """Show nothing."""

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None:
        """Show nothing."""


def _facts(loss: float, eta_s: float | None) -> str:
    shown = "" if math.isnan(loss) else f"loss {loss:.4f}"
    return f"{shown}  {duration(eta_s)} left".strip() if eta_s is not None else shown


@contextmanager
def show_progress(*, quiet: bool = False) -> Iterator[ProgressView]:
    """Yield a view: a bar if standard error is a terminal, else lines; with `quiet`, nothing."""
    if quiet:
        yield _NoProgress()
        return
    if not is_terminal():
        yield _Lines()
        return
    bars = StepBars()
    with bars.progress:
        yield _Bar(bars)
