"""Stored files that a request is about to make a job of: they stay until the job's row takes their pins' place."""

from __future__ import annotations

from collections.abc import Collection
from types import TracebackType
from typing import Self

from meshdeform.record.files import FileLedger

__all__ = ["Pins"]


class Pins:
    """Pins of one request, given back where it ends without a job.

    Parameters
    ----------
    files : FileLedger
    """

    def __init__(self, files: FileLedger) -> None:
        self._files = files
        self._keys: list[str] = []

    def take(self, key: str) -> None:
        """Pin a file, once."""
        if key not in self._keys:
            self._files.pin(key)
            self._keys.append(key)

    def passed_on(self, keys: Collection[str]) -> None:
        """A job is recorded: its row keeps these files now."""
        self._keys = [key for key in self._keys if key not in keys]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._keys:
            self._files.unpin(self._keys)
