"""Tells the record which worker is alive, from a thread: a record that is slow must not keep the supervisor waiting."""

from __future__ import annotations

import logging
import threading
from types import TracebackType
from typing import Self

from meshdeform.errors import MeshdeformError
from meshdeform.record.workers import WorkerRegistry

__all__ = ["Presence"]

_log = logging.getLogger(__name__)
_EVERY_S = 10.0


class Presence:
    """Says so every ten seconds for the length of a `with` block, and takes it back at its end.

    Parameters
    ----------
    registry : WorkerRegistry
    queue, device : str
        As the settings have them.
    """

    def __init__(self, registry: WorkerRegistry, queue: str, device: str) -> None:
        self._registry, self._queue, self._device = registry, queue, device
        self._lock = threading.Lock()
        self._worker_id = ""
        self._known: set[str] = set()
        self._changed, self._done = threading.Event(), False
        self._thread = threading.Thread(target=self._run, name="presence", daemon=True)

    def announce(self, worker_id: str) -> None:
        """From now on this is the worker."""
        with self._lock:
            self._worker_id = worker_id
        self._changed.set()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done = True
        self._changed.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._done:
            self._changed.clear()
            with self._lock:
                worker_id = self._worker_id
            self._say(worker_id)
            self._changed.wait(_EVERY_S)
        self._say("")

    def _say(self, worker_id: str) -> None:
        try:
            if worker_id:
                self._registry.seen(worker_id, self._queue, self._device)
            for gone in self._known - {worker_id}:
                self._registry.gone(gone)
            self._known = {worker_id} - {""}
        except MeshdeformError as error:
            # Those that are silent count as gone by themselves.
            self._known |= {worker_id} - {""}
            _log.warning("the record does not know that this worker is alive: %s", error.detail)
