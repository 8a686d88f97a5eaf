"""Cache the values of a process that were used last (least recently used go first)."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from threading import Lock
from typing import Generic, TypeVar

_T = TypeVar("_T")
_MOST = 64


class Recent(Generic[_T]):
    """The last values by their keys, `most` of them, for any number of threads.

    `most_bytes` bounds what `put` says that they take together; a value that takes more alone is not kept.
    """

    def __init__(self, most: int = _MOST, most_bytes: int = 0) -> None:
        self._values: OrderedDict[Hashable, _T] = OrderedDict()
        self._sizes: dict[Hashable, int] = {}
        self._most, self._most_bytes, self._lock = most, most_bytes, Lock()

    def get(self, key: Hashable) -> _T | None:
        """Return a value, which is the last to be forgotten now."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def put(self, key: Hashable, value: _T, size: int = 0) -> None:
        """Keep a value that takes so many bytes, and forget those that were used least recently."""
        with self._lock:
            self._values.pop(key, None)
            self._values[key], self._sizes[key] = value, size
            while len(self._values) > self._most or self._too_large:
                del self._sizes[self._values.popitem(last=False)[0]]

    @property
    def _too_large(self) -> bool:
        return 0 < self._most_bytes < sum(self._sizes.values())
