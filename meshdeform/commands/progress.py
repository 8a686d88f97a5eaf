"""Progress for a person: a bar on a terminal, a line now and then elsewhere; always on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

import typer

__all__ = ["ProgressView", "show_progress"]

_LINE_EVERY_S = 5.0


class ProgressView(Protocol):
    """What a job tells about itself."""

    def phase(self, name: str) -> None:
        """A new phase begins."""

    def step(self, step: int, total_steps: int, loss: float) -> None:
        """A step is done."""


class _Bar:
    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        self.progress = Progress(
            TextColumn("{task.description:<11}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("loss {task.fields[loss]}"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self.progress.add_task("starting", total=None, loss="-")

    def phase(self, name: str) -> None:
        self.progress.update(self._task, description=name)

    def step(self, step: int, total_steps: int, loss: float) -> None:
        self.progress.update(self._task, completed=step, total=total_steps, loss=f"{loss:.4f}")


class _Lines:
    def __init__(self) -> None:
        self._last = time.monotonic()

    def phase(self, name: str) -> None:
        typer.echo(name, err=True)

    def step(self, step: int, total_steps: int, loss: float) -> None:
        now = time.monotonic()
        if step == total_steps or now - self._last >= _LINE_EVERY_S:
            self._last = now
            typer.echo(f"step {step}/{total_steps}  loss {loss:.4f}", err=True)


@contextmanager
def show_progress() -> Iterator[ProgressView]:
    """A view for the block: a bar if standard error is a terminal, else lines."""
    if not sys.stderr.isatty():
        yield _Lines()
        return
    bar = _Bar()
    with bar.progress:
        yield bar
