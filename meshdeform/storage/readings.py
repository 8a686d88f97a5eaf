"""Keep readings of assets in an object store, for all processes of a service, for one to two weeks.

Keys are `readings/WEEK/KEY`, the number of the week being that since 1970. What is older than the week before is
removed, and more than that, the older week first, where all take too much.
"""

from __future__ import annotations

import logging
import time
from pathlib import Path

from meshdeform.errors import MeshdeformError, NotFoundError
from meshdeform.storage.store import ObjectStore

__all__ = ["StoredReadings", "remove_old_readings"]

_PREFIX = "readings"
_WEEK_S = 7 * 86_400
_MOST_BYTES = 64 * 2**20
_MOST_BYTES_OF_ALL, _MOST_OF_ALL = 2**30, 100_000

_log = logging.getLogger(__name__)


class StoredReadings:
    """The readings in an object store. What does not answer has nothing, and keeps nothing.

    `samples`: a folder of this machine for whoever reads (`meshdeform.runs.kept_readings`).
    """

    def __init__(self, store: ObjectStore, samples: Path | None = None) -> None:
        self._store, self.samples = store, samples

    def get(self, key: str) -> bytes | None:
        """Return what was kept in this week or the last; None if there is nothing."""
        week = _week()
        for number in (week, week - 1):
            try:
                return self._store.get(f"{_PREFIX}/{number}/{key}")
            except NotFoundError:
                continue
            except MeshdeformError as error:
                _log.warning("a kept reading cannot be had: %s", error)
                return None
        return None

    def put(self, key: str, data: bytes) -> None:
        """Keep bytes until the end of next week."""
        if len(data) > _MOST_BYTES:
            return
        try:
            self._store.put(f"{_PREFIX}/{_week()}/{key}", data)
        except MeshdeformError as error:
            _log.warning("a reading is not kept: %s", error)


def remove_old_readings(store: ObjectStore) -> None:
    """Remove what is older than last week, and more if all take too much. Safe to interrupt and repeat.

    `UnavailableError`: the store does not answer; the next call does the rest.
    """
    sizes: dict[int, int] = {}
    counts: dict[int, int] = {}
    for key, size in store.list(f"{_PREFIX}/"):
        week = int(number) if (number := key.split("/")[1]).isdigit() else 0
        sizes[week], counts[week] = sizes.get(week, 0) + size, counts.get(week, 0) + 1
    for week in sorted(sizes):
        too_much = sum(sizes.values()) > _MOST_BYTES_OF_ALL or sum(counts.values()) > _MOST_OF_ALL
        if week < _week() - 1 or too_much:
            store.delete_prefix(f"{_PREFIX}/{week}/")
            del sizes[week], counts[week]


def _week() -> int:
    return int(time.time()) // _WEEK_S
