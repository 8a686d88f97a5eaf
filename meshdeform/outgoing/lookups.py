"""Resolve the names of hosts in threads that nobody need wait for."""

from __future__ import annotations

import queue
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from meshdeform.errors import LimitError
from meshdeform.outgoing.addresses import system_lookup

LOOKUP_S = 5.0
"""Seconds to wait for the addresses of a host."""
_Result = TypeVar("_Result")


class LookupPool:
    """A fixed number of daemon threads. Unlike those of an executor, they do not keep the process from exiting.

    One owner may have `share` calls waiting or running; without it, any number.
    """

    def __init__(self, threads: int, share: int | None = None) -> None:
        self._most, self._share = threads, share
        self._calls: queue.SimpleQueue[tuple[Future[Any], Callable[[], Any]]] = queue.SimpleQueue()
        self._busy: Counter[str] = Counter()
        self._threads = 0
        self._lock = threading.Lock()

    def submit(self, owner: str, call: Callable[[], _Result]) -> Future[_Result]:
        """Start a call as soon as a thread is free. A cancelled future that has not started never runs.

        `LimitError`: the owner has too many unfinished calls.
        """
        future: Future[_Result] = Future()
        with self._lock:
            if self._share is not None and self._busy[owner] >= self._share:
                raise LimitError(
                    f"{self._share} host names are already being resolved for this API key.",
                    advice="Try again in a moment.",
                )
            self._busy[owner] += 1
            if self._threads < min(self._most, self._busy.total()):
                self._threads += 1
                threading.Thread(target=self._run, name="lookup", daemon=True).start()
        future.add_done_callback(lambda _: self._release(owner))
        self._calls.put((future, call))
        return future

    def lookup(self, host: str, port: int) -> list[str]:
        """Resolve a host and return its addresses. A `Lookup` with a deadline.

        `OSError`: the host has no address, or its addresses did not arrive in time.
        """
        future = self.submit("", lambda: system_lookup(host, port))
        try:
            return list(future.result(LOOKUP_S))
        finally:
            future.cancel()

    def _release(self, owner: str) -> None:
        with self._lock:
            self._busy[owner] -= 1
            if not self._busy[owner]:
                del self._busy[owner]

    def _run(self) -> None:
        while True:
            future, call = self._calls.get()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(call())
            except BaseException as error:
                future.set_exception(error)
