"""Items over several processes, such that a process that dies costs one item and not the run.

Each process gets one item at a time through a pipe. Ctrl-C reaches only the parent, which stops the others; what they
had not finished was not written.
"""

from __future__ import annotations

import multiprocessing
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from meshdeform.errors import WorkerLostError

__all__ = ["each"]

T = TypeVar("T")
R = TypeVar("R")

_STOP_GRACE_S = 5.0


def each(
    items: Sequence[T], start: Callable[[], Callable[[T], R]], jobs: int
) -> Iterator[tuple[T, R | WorkerLostError]]:
    """Results in the order in which they are done.

    Parameters
    ----------
    items : sequence
    start : callable
        Called once in each process; gives what does an item. It and the items must be picklable with `jobs` > 1.
    jobs : int
        Processes; with 1, everything is done here.

    Raises
    ------
    WorkerLostError
        `start` failed in a process.
    """
    if jobs <= 1:
        work = start()
        for item in items:
            yield item, work(item)
        return
    queue = deque(items)
    workers = [_Worker(start) for _ in range(min(jobs, len(items)))]
    try:
        for worker in workers:
            worker.give(queue.popleft())
        while busy := {worker.pipe: worker for worker in workers if worker.item is not None}:
            for pipe in wait(list(busy)):
                worker = busy[pipe]  # type: ignore[index]
                item, result = worker.take()
                if isinstance(result, WorkerLostError) and queue:
                    workers[workers.index(worker)] = worker = _Worker(start)
                if queue:
                    worker.give(queue.popleft())
                yield item, result
    finally:
        for worker in workers:
            worker.stop()


class _Worker(Generic[T, R]):
    """A process and what it is doing."""

    def __init__(self, start: Callable[[], Callable[[T], R]]) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.item: T | None = None
        self._process = context.Process(target=_serve, args=(other, start), daemon=True)
        self._process.start()
        other.close()

    def give(self, item: T) -> None:
        self.item = item
        self.pipe.send(item)

    def take(self) -> tuple[T, R | WorkerLostError]:
        """What became of the item; raises WorkerLostError where the process could not even start."""
        item, self.item = self.item, None
        assert item is not None
        try:
            kind, result = self.pipe.recv()
        except EOFError:
            self._process.join(_STOP_GRACE_S)
            return item, WorkerLostError(f"The process died with exit code {self._process.exitcode}.")
        if kind == "broken":
            raise WorkerLostError(f"A process of the benchmark could not start: {result}")
        return item, result

    def stop(self) -> None:
        self.pipe.close()
        self._process.terminate()
        self._process.join(_STOP_GRACE_S)


def _serve(pipe: Connection[Any, Any], start: Callable[[], Callable[[Any], Any]]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # As an exception, so that what is half written is cleaned up.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        work = start()
    except Exception:
        pipe.recv()
        pipe.send(("broken", traceback.format_exc()))
        return
    try:
        while True:
            pipe.send(("done", work(pipe.recv())))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return  # the parent is gone, or wants no more
