"""Let requests wait for jobs, with one query for all of them; `Prefer: wait=N` waits for the end of one.

A waiting request holds no thread and no database connection: it is a task with an entry here. While there are any, one
query per tick reads the state of all their jobs, and the requests whose condition holds are woken.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import signal
import threading
from collections import Counter
from collections.abc import AsyncIterator, Callable, Collection, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import Annotated, Any, TypeVar, TypeVarTuple

import anyio
from anyio import CancelScope, CapacityLimiter, to_thread
from fastapi import Header, Request

from meshdeform.api.limits import MAX_WAIT_S
from meshdeform.errors import LimitError, UnavailableError
from meshdeform.record.changes import JobPosition
from meshdeform.record.models import Job
from meshdeform.record.repository import JobRecord
from meshdeform.serving.connections import connection_limit

MOST_HELD_OF_ONE = 100
"""Maximum number of requests of one owner that wait at the same time in one process."""

_TICK_S = 0.25
_AWAY_S = 2.0  # longest pause between two queries while the record is unavailable
_CLOSING_S = 2.0  # when the process ends, how long to wait for clients that do not read
_READERS = 4
_MOST_HELD = 2000
_log = logging.getLogger(__name__)
_Result = TypeVar("_Result")
_Arguments = TypeVarTuple("_Arguments")
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_WAIT = re.compile(r'wait\s*=\s*"?(\d{1,9})"?\s*(?:;.*)?', re.IGNORECASE)
Prefer = Annotated[
    str | None,
    Header(
        description="`wait=N`: delay the response until the job has finished, for at most N seconds "
        f"(1 to {MAX_WAIT_S}). Default: respond at once.",
        max_length=200,
        examples=["wait=30"],
    ),
]


def most_held() -> int:
    """Return how many requests may wait in this process: at most half as many as it may have connections."""
    return min(_MOST_HELD, connection_limit() // 2)


@dataclass(eq=False)
class _Waiter:
    job_id: str
    wanted: Callable[[JobPosition | None], bool]
    woken: asyncio.Future[None]


class JobWaiters:
    """Let requests wait for jobs.

    Every `tick_s` seconds, one query (`EventLog.heads`) asks for the state of all jobs that requests wait for.
    """

    def __init__(self, heads: Callable[[Collection[str]], dict[str, JobPosition]], tick_s: float = _TICK_S) -> None:
        self._heads, self._tick_s = heads, tick_s
        self._waiters: set[_Waiter] = set()
        self._wanted = asyncio.Event()
        self._held: Counter[str] = Counter()
        self._scopes: set[CancelScope] = set()
        self._most = most_held()
        self._closing = False
        # Apart from the threads of other routes, which must not wait when many requests are woken at once.
        self._readers = CapacityLimiter(_READERS)

    @property
    def closing(self) -> bool:
        """Whether the process is ending, so that waiting requests must return."""
        return self._closing

    @property
    def waiting(self) -> int:
        """Number of requests that wait for a change of their job."""
        return len(self._waiters)

    @property
    def held(self) -> int:
        """Number of slots in use."""
        return len(self._scopes)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Query the record while requests wait, until the block ends."""
        task = asyncio.create_task(self._run())
        try:
            yield
        finally:
            self.close()
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    def close(self) -> None:
        """Wake all waiting requests. Call it on the event loop."""
        self._closing = True
        for waiter in self._waiters:
            _wake(waiter)
        for scope in self._scopes:
            scope.deadline = anyio.current_time() + _CLOSING_S

    @contextmanager
    def slot(self, owner: str) -> Iterator[None]:
        """Hold a slot while a request waits; `LimitError`: none is free.

        The block is cancelled some time after `close`. Without a key the owner is empty, and only the limit of the
        process applies.
        """
        if owner and self._held[owner] >= MOST_HELD_OF_ONE:
            raise LimitError(
                f"{MOST_HELD_OF_ONE} requests with this key are already waiting for jobs.",
                advice="Close unused streams, or poll the jobs instead.",
            )
        if self.held >= self._most:
            raise LimitError(
                f"{self._most} requests are already waiting for jobs.",
                advice="Poll the job instead.",
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

    async def until(self, job_id: str, condition: Callable[[JobPosition | None], bool], timeout_s: float) -> bool:
        """Wait until a job meets a condition. Return whether it did, before the timeout and the end of the process.

        The condition takes the state of the job, None if it does not exist.
        """
        if self._closing or timeout_s <= 0:
            return False
        waiter = _Waiter(job_id, condition, asyncio.get_running_loop().create_future())
        self._waiters.add(waiter)
        self._wanted.set()
        try:
            with anyio.move_on_after(timeout_s):
                await waiter.woken
                return not self._closing
            return False
        finally:
            self._waiters.discard(waiter)

    async def read(self, query: Callable[[*_Arguments], _Result], *arguments: *_Arguments) -> _Result:
        """Call a function that reads the record, in one of the threads for waiting requests."""
        return await to_thread.run_sync(query, *arguments, limiter=self._readers, abandon_on_cancel=True)

    async def _run(self) -> None:
        pause_s = self._tick_s
        while True:
            await self._wanted.wait()
            if not self._waiters:
                self._wanted.clear()
                continue
            try:
                await self._poll()
                pause_s = self._tick_s
            except UnavailableError:
                # The record has logged the error. The requests keep waiting.
                pause_s = min(2 * pause_s, _AWAY_S)
            except Exception:
                _log.exception("cannot query the jobs that requests wait for; trying again")
                pause_s = _AWAY_S
            await asyncio.sleep(pause_s)

    async def _poll(self) -> None:
        # A copy: the result does not cover requests that arrive during the query.
        waiters = list(self._waiters)
        heads = await self.read(self._heads, {waiter.job_id for waiter in waiters})
        for waiter in waiters:
            if waiter.wanted(heads.get(waiter.job_id)):
                _wake(waiter)


def _wake(waiter: _Waiter) -> None:
    if not waiter.woken.done():
        waiter.woken.set_result(None)


@contextmanager
def on_termination(callback: Callable[[], None]) -> Iterator[None]:
    """Call `callback` on the running loop when a signal ends the process, before the server's own handler.

    Signals arrive only in the main thread. A program that runs the application in another thread must call
    `app.state.app_state.waiters.close` itself.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    loop = asyncio.get_running_loop()
    before: dict[int, Any] = {number: signal.getsignal(number) for number in _SIGNALS}

    def handle(number: int, frame: FrameType | None) -> None:
        loop.call_soon_threadsafe(callback)
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


async def settled(
    waiters: JobWaiters,
    record: JobRecord,
    job_id: str,
    owner: str | None,
    wait_s: float,
    *,
    request: Request,
) -> Job:
    """Return a job once it has finished, or earlier on timeout, on disconnection, or if no slot is free.

    A request, its body already read, gives its slot back when its client disconnects. An owner of None means any.
    """
    job = await waiters.read(record.get, job_id, owner)
    if job.state.terminal or wait_s <= 0:
        return job
    # If no slot is free, respond at once: waiting is only a preference.
    with suppress(LimitError):
        await wait_here(waiters, job_id, owner, _over, wait_s, request=request)
    try:
        return await waiters.read(record.get, job_id, owner)
    except UnavailableError:
        return job


async def wait_here(
    waiters: JobWaiters,
    job_id: str,
    owner: str | None,
    condition: Callable[[JobPosition | None], bool],
    wait_s: float,
    *,
    request: Request,
) -> None:
    """Hold a slot (`LimitError`: none is free) until a job meets a condition, time is up, or the client disconnects."""
    with waiters.slot(owner or ""):
        async with anyio.create_task_group() as group:
            group.start_soon(_cancel_when_gone, request, group.cancel_scope)
            await waiters.until(job_id, condition, wait_s)
            group.cancel_scope.cancel()


def _over(head: JobPosition | None) -> bool:
    return head is None or head.state.terminal


async def _cancel_when_gone(request: Request, waiting: CancelScope) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
    waiting.cancel()


def preferred_wait(request: Request) -> int | None:
    """Return how many seconds a request prefers to wait, at most MAX_WAIT_S; None without a valid preference."""
    return _wait(request.headers.getlist("prefer"))


def applied(wait_s: int | None) -> dict[str, str]:
    """Return the header that confirms the preference."""
    return {} if wait_s is None else {"Preference-Applied": f"wait={wait_s}"}


def _wait(headers: Sequence[str]) -> int | None:
    for preference in ",".join(headers).split(","):
        # The first one counts (RFC 7240).
        if match := _WAIT.fullmatch(preference.strip()):
            return min(int(match[1]), MAX_WAIT_S) or None
    return None
