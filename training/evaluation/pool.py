"""Distribute items over several processes; a process that dies loses one item, not the run.

Each process gets one item at a time through a pipe. Ctrl-C reaches only the parent, which stops the others; unfinished
items are not written.
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

T = TypeVar("T")
R = TypeVar("R")

_STOP_GRACE_S = 5.0


def each(
    items: Sequence[T], start: Callable[[], Callable[[T], R]], jobs: int
) -> Iterator[tuple[T, R | WorkerLostError]]:
    """Yield results in the order in which they are done.

    Parameters
    ----------
    items : sequence
    start : callable
        Called once in each process; returns the function to apply. It and the items must be picklable if `jobs` > 1.
    jobs : int
        Number of processes; with 1, all work is done in this process.

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
    """A process and its current item."""

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
        """Return the item and its result; raise WorkerLostError if the process could not start."""
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
    # Raise an exception, so that partly written files are cleaned up.
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
        # The parent has exited or closed the pipe. If it also terminates this process, nothing is left to clean up, and
        # an exception while the interpreter shuts down would be printed.
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
