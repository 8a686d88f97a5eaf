"""Hold what reads a body, so that it is read when a part is asked for that its file does not tell, and only once."""

from __future__ import annotations

from collections.abc import Callable

from meshdeform.reading import Reading


def _nothing() -> None:
    return None


class Reader:
    """Read a body when that is needed.

    `read`: returns what was found, or None if the body cannot be read; by default nothing reads it.
    """

    def __init__(self, read: Callable[[], Reading | None] = _nothing) -> None:
        self._read = read
        self._answers: list[Reading | None] = []

    @property
    def reading(self) -> Reading | None:
        """What was found; None if the body cannot be read."""
        if not self._answers:
            self._answers.append(self._read())
        return self._answers[0]

    @property
    def made(self) -> Reading | None:
        """What was found, if somebody has asked; None if nobody has, or the body cannot be read."""
        return self._answers[0] if self._answers else None
