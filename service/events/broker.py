"""Who waits for a job, and the one look at the record that serves them all.

A request that waits holds no thread and no connection to the database: it is a task with an entry here. While there is
any, one query a tick asks where all of their jobs stand, and wakes those whose job is where they want it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import resource
import signal
import threading
from collections import Counter
from collections.abc import AsyncIterator, Callable, Collection, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any, TypeVar, TypeVarTuple

import anyio
from anyio import CancelScope, CapacityLimiter, to_thread

from meshdeform.errors import LimitError, UnavailableError
from meshdeform.record.events import Head

__all__ = ["MOST_HELD_OF_ONE", "JobWaiters", "most_held", "on_termination"]

MOST_HELD_OF_ONE = 100
"""Requests of one owner that may wait at the same time, in one process."""

_TICK_S = 0.25
_AWAY_S = 2.0  # at most so long between two looks while the record is away
_CLOSING_S = 2.0  # a reader that stands still is not waited for any longer when the process ends
_READERS = 4
_MOST_HELD = 2000
_log = logging.getLogger(__name__)
_Result = TypeVar("_Result")
_Arguments = TypeVarTuple("_Arguments")


def most_held() -> int:
    """How many requests may wait in this process: they take half of the files that it may open, the rest goes on."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return _MOST_HELD if soft == resource.RLIM_INFINITY else min(_MOST_HELD, soft // 2)


@dataclass(eq=False)
class _Waiter:
    job_id: str
    wanted: Callable[[Head | None], bool]
    woken: asyncio.Future[None]


class JobWaiters:
    """Lets requests wait for jobs.

    Parameters
    ----------
    heads : callable
        `EventLog.heads`: where jobs stand; those that are gone are missing.
    tick_s : float
        Seconds between two looks.
    """

    def __init__(self, heads: Callable[[Collection[str]], dict[str, Head]], tick_s: float = _TICK_S) -> None:
        self._heads, self._tick_s = heads, tick_s
        self._waiters: set[_Waiter] = set()
        self._somebody = asyncio.Event()
        self._held: Counter[str] = Counter()
        self._scopes: set[CancelScope] = set()
        self._most = most_held()
        self._closing = False
        # Apart from the threads of the other routes, which never wait for a crowd that is woken at once.
        self._readers = CapacityLimiter(_READERS)

    @property
    def closing(self) -> bool:
        """Whether the process ends: whatever waits must return now."""
        return self._closing

    @property
    def waiting(self) -> int:
        """How many wait for their job to change now."""
        return len(self._waiters)

    @property
    def held(self) -> int:
        """How many requests have a place."""
        return len(self._scopes)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Look while somebody waits, until the block ends."""
        task = asyncio.create_task(self._run())
        try:
            yield
        finally:
            self.close()
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    def close(self) -> None:
        """Let everybody go who waits. To be called on the loop."""
        self._closing = True
        for waiter in self._waiters:
            _wake(waiter)
        for scope in self._scopes:
            scope.deadline = anyio.current_time() + _CLOSING_S

    @contextmanager
    def place(self, owner: str) -> Iterator[None]:
        """Hold a place while a request waits. What is still in the block some time after `close` is cancelled.

        Parameters
        ----------
        owner : str
            Whose request it is; empty where keys are off, and then only the places of the process count.

        Raises
        ------
        LimitError
            There is none left.
        """
        if owner and self._held[owner] >= MOST_HELD_OF_ONE:
            raise LimitError(
                f"{MOST_HELD_OF_ONE} requests of this key wait for jobs at the same time.",
                advice="Close streams that nobody reads, or look at the jobs from time to time instead.",
            )
        if self.held >= self._most:
            raise LimitError(
                f"{self._most} requests wait for jobs at the same time.",
                advice="Look at the job from time to time instead.",
            )
        self._held[owner] += 1
        scope = CancelScope()
        if self._closing:
            scope.deadline = anyio.current_time() + _CLOSING_S
        self._scopes.add(scope)
        try:
            with scope:
                yield
        finally:
            self._scopes.discard(scope)
            self._held[owner] -= 1
            if not self._held[owner]:
                del self._held[owner]

    async def until(self, job_id: str, wanted: Callable[[Head | None], bool], timeout_s: float) -> bool:
        """Wait until a job is where it is wanted; whether it came to that in time, and before the process ends.

        Parameters
        ----------
        job_id : str
        wanted : callable
            Gets where the job stands; None: it is gone.
        timeout_s : float
        """
        if self._closing or timeout_s <= 0:
            return False
        waiter = _Waiter(job_id, wanted, asyncio.get_running_loop().create_future())
        self._waiters.add(waiter)
        self._somebody.set()
        try:
            with anyio.move_on_after(timeout_s):
                await waiter.woken
                return not self._closing
            return False
        finally:
            self._waiters.discard(waiter)

    async def read(self, look: Callable[[*_Arguments], _Result], *arguments: *_Arguments) -> _Result:
        """Call something that looks at the record, in one of the few threads for those who wait."""
        return await to_thread.run_sync(look, *arguments, limiter=self._readers, abandon_on_cancel=True)

    async def _run(self) -> None:
        pause_s = self._tick_s
        while True:
            await self._somebody.wait()
            if not self._waiters:
                self._somebody.clear()
                continue
            try:
                await self._look()
                pause_s = self._tick_s
            except UnavailableError:
                # The record has logged it. Who waits goes on waiting: nothing is lost.
                pause_s = min(2 * pause_s, _AWAY_S)
            except Exception:
                _log.exception("those who wait for jobs are not told now")
                pause_s = _AWAY_S
            await asyncio.sleep(pause_s)

    async def _look(self) -> None:
        # Who comes while the record is asked is not in its answer.
        waiters = list(self._waiters)
        heads = await self.read(self._heads, {waiter.job_id for waiter in waiters})
        for waiter in waiters:
            if waiter.wanted(heads.get(waiter.job_id)):
                _wake(waiter)


def _wake(waiter: _Waiter) -> None:
    if not waiter.woken.done():
        waiter.woken.set_result(None)


_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def on_termination(tell: Callable[[], None]) -> Iterator[None]:
    """Call something on the running loop when a signal ends the process, before the server's own handler.

    Elsewhere than in the main thread there are no signals: who embeds the application there calls it himself
    (`app.state.app_state.waiters.close`).
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    loop = asyncio.get_running_loop()
    before: dict[int, Any] = {number: signal.getsignal(number) for number in _SIGNALS}

    def handle(number: int, frame: FrameType | None) -> None:
        loop.call_soon_threadsafe(tell)
        if callable(before[number]):
            before[number](number, frame)
        elif before[number] is signal.SIG_DFL:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

    for number in _SIGNALS:
        signal.signal(number, handle)
    try:
        yield
    finally:
        for number in _SIGNALS:
            if signal.getsignal(number) is handle:
                signal.signal(number, before[number])
