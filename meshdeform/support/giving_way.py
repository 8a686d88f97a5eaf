"""Let long work be stopped from outside: in its loops it asks whether anybody still waits for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["give_way", "stopped_by"]


def _nobody() -> None:
    """Never stop."""


_check: ContextVar[Callable[[], None]] = ContextVar("check", default=_nobody)


def give_way() -> None:
    """Raise what the check of `stopped_by` does: work that is stopped leaves nothing half done behind."""
    _check.get()()


@contextmanager
def stopped_by(check: Callable[[], None]) -> Iterator[None]:
    """Let a check, which raises to stop, be asked by the work in the block, in this thread."""
    token = _check.set(check)
    try:
        yield
    finally:
        _check.reset(token)
