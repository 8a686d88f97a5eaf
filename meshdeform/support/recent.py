"""Remember the last values of a process."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from threading import Lock
from typing import Generic, TypeVar

_T = TypeVar("_T")
_MOST = 64


class Recent(Generic[_T]):
    """The last values by their keys, `most` of them, for any number of threads."""

    def __init__(self, most: int = _MOST) -> None:
        self._values: OrderedDict[Hashable, _T] = OrderedDict()
        self._most, self._lock = most, Lock()

    def get(self, key: Hashable) -> _T | None:
        """Return a value, which is the last to be forgotten now."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def put(self, key: Hashable, value: _T) -> None:
        """Keep a value, and forget the one that was used least recently."""
        with self._lock:
            self._values[key] = value
            while len(self._values) > self._most:
                self._values.popitem(last=False)
