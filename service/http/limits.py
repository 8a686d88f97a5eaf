"""Limit the request rate of each key, and the slots of each owner.

The rate is a leaky bucket in Redis, shared by all API processes. The generic cell rate algorithm stores one number per
key: the time at which its bucket will be empty. While Redis is unavailable, each process limits with buckets of its
own.

Source: ITU-T I.371, annex A (the algorithm); draft-ietf-httpapi-ratelimit-headers (the headers).
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import Counter, OrderedDict, deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

import anyio
from redis import Redis
from redis.backoff import NoBackoff
from redis.retry import Retry

from meshdeform.errors import LimitError, UnavailableError
from meshdeform.record.queue import REDIS_AWAY

_log = logging.getLogger(__name__)
_MINUTE_S = 60.0
_LEAST_BURST = 10
_REDIS_TIMEOUT_S = 0.25
_REDIS_PAUSE_S = 2.0
_MOST_BUCKETS = 10_000

# Redis' clock, so that hosts with different clocks can share a bucket. If it is set back, a key is refused for at most
# the time that its burst takes.
_TAKE = """
local time = redis.call('TIME')
local now = time[1] + time[2] / 1000000
local interval, burst = tonumber(ARGV[1]), tonumber(ARGV[2])
local empty_at = tonumber(redis.call('GET', KEYS[1]) or 0)
empty_at = math.min(math.max(empty_at, now), now + interval * burst)
local filled = empty_at + interval
local wait = filled - interval * burst - now
if wait > 0.000001 then
  return {string.format('%.6f', wait), string.format('%.6f', empty_at - now)}
end
redis.call('SET', KEYS[1], string.format('%.6f', filled), 'PX', math.ceil((filled - now) * 1000))
return {'0', string.format('%.6f', filled - now)}
"""


@dataclass(frozen=True)
class Rate:
    """A rate of `per_minute` requests, of which `burst` may come at once."""

    per_minute: int
    burst: int

    @classmethod
    def of(cls, per_minute: int) -> Rate:
        """Return a rate whose burst is a tenth of a minute's requests, but at least ten, or all if there are fewer."""
        return cls(per_minute, max(min(per_minute, _LEAST_BURST), per_minute // 10))

    @property
    def interval_s(self) -> float:
        """Seconds between two requests at this rate."""
        return _MINUTE_S / self.per_minute


@dataclass(frozen=True)
class BucketState:
    """The state of a bucket after a request, which is allowed if `wait_s` is 0.

    `remaining` counts further requests that are allowed now; in `reset_s` seconds a whole burst is.
    """

    wait_s: float
    remaining: int
    reset_s: int


class Buckets:
    """Buckets of this process, by name. Thread-safe."""

    def __init__(self) -> None:
        self._empty_at: dict[str, float] = {}
        self._lock = threading.Lock()

    def take(self, name: str, rate: Rate, now: float | None = None) -> BucketState:
        """Count one request against a bucket, unless it is full. `now` defaults to the monotonic clock."""
        now = time.monotonic() if now is None else now
        with self._lock:
            empty_at = max(self._empty_at.get(name, now), now)
            filled = empty_at + rate.interval_s
            wait_s = filled - rate.interval_s * rate.burst - now
            if wait_s > 1e-6:
                return _verdict(rate, wait_s, empty_at - now)
            if name not in self._empty_at and len(self._empty_at) >= _MOST_BUCKETS:
                self._make_room(now)
            self._empty_at[name] = filled
        return _verdict(rate, 0.0, filled - now)

    def give_back(self, name: str, rate: Rate) -> None:
        """Undo one `take`."""
        with self._lock:
            if name in self._empty_at:
                self._empty_at[name] -= rate.interval_s

    def _make_room(self, now: float) -> None:
        self._empty_at = {name: empty_at for name, empty_at in self._empty_at.items() if empty_at > now}
        if len(self._empty_at) >= _MOST_BUCKETS:
            # So many are an attack. Drop the buckets that would be empty first: they lose least.
            for name in sorted(self._empty_at, key=self._empty_at.__getitem__)[: _MOST_BUCKETS // 2]:
                del self._empty_at[name]


class RateLimiter:
    """Buckets in Redis, or in this process while Redis is unavailable. Thread-safe.

    The prefix of the names in Redis differs between deployments that share a Redis.
    """

    def __init__(self, redis_url: str, prefix: str) -> None:
        # Requests wait for this, so do not retry, and time out soon.
        self._redis = Redis.from_url(
            redis_url,
            socket_connect_timeout=_REDIS_TIMEOUT_S,
            socket_timeout=_REDIS_TIMEOUT_S,
            retry=Retry(NoBackoff(), 0),
            decode_responses=True,
        )
        self._take = self._redis.register_script(_TAKE)
        self._prefix = prefix
        self._local = Buckets()
        self._away_until = -math.inf

    def take(self, name: str, per_minute: int) -> BucketState:
        """Count one request against a name. Never raises, and never waits long."""
        rate = Rate.of(per_minute)
        if time.monotonic() < self._away_until:
            return self._local.take(name, rate)
        try:
            wait_s, level_s = self._take(keys=[f"{self._prefix}:rate:{name}"], args=[rate.interval_s, rate.burst])
        except REDIS_AWAY as error:
            if self._away_until == -math.inf:
                _log.warning("Redis is away (%s): rate limits are per process", type(error).__name__)
            self._away_until = time.monotonic() + _REDIS_PAUSE_S
            return self._local.take(name, rate)
        self._away_until = -math.inf
        return _verdict(rate, float(wait_s), float(level_s))

    def close(self) -> None:
        """Close the connections."""
        self._redis.close()


def _verdict(rate: Rate, wait_s: float, level_s: float) -> BucketState:
    remaining = 0 if wait_s else math.floor(rate.burst - level_s / rate.interval_s + 1e-6)
    return BucketState(wait_s, max(0, remaining), math.ceil(level_s))


class FairSlots:
    """A number of slots on one event loop.

    One owner may hold `per_owner` of them; the others stay free for other owners. A request waits `wait_s` seconds for
    a slot; the purpose, as in "files are being received", is for the error.
    """

    def __init__(self, total: int, per_owner: int, *, wait_s: float, purpose: str) -> None:
        self.total, self.per_owner, self.wait_s = total, per_owner, wait_s
        self._purpose = purpose
        self._held: Counter[str] = Counter()
        self._waiting: OrderedDict[str, deque[anyio.Event]] = OrderedDict()

    @asynccontextmanager
    async def slot(self, owner_id: str, *, soon_s: float | None = None, most: int = 0) -> AsyncIterator[None]:
        """Hold a slot while the block runs, after waiting for a turn; `UnavailableError`: none became free in time.

        `soon_s`: the most seconds to wait, after which, or if `most` of the owner's wait already, it is `LimitError`.
        """
        if soon_s is None:
            await self._acquire(owner_id, self.wait_s)
        else:
            await self._acquire_soon(owner_id, soon_s, most)
        try:
            yield
        finally:
            self._release(owner_id)

    async def _acquire_soon(self, owner_id: str, wait_s: float, most: int) -> None:
        too_many = f"Too many {self._purpose} at the same time."
        if len(self._waiting.get(owner_id, ())) >= most:
            raise LimitError(too_many, retry_after_s=math.ceil(wait_s))
        try:
            await self._acquire(owner_id, wait_s)
        except UnavailableError as error:
            raise LimitError(error.detail, retry_after_s=math.ceil(wait_s)) from error

    async def _acquire(self, owner_id: str, wait_s: float) -> None:
        turn = anyio.Event()
        self._waiting.setdefault(owner_id, deque()).append(turn)
        self._grant()
        try:
            with anyio.move_on_after(wait_s):
                await turn.wait()
                return
        except BaseException:
            self._leave(owner_id, turn)
            raise
        if not turn.is_set():
            self._leave(owner_id, turn)
            raise UnavailableError(
                f"Too many {self._purpose} at the same time: {self._held[owner_id]} of yours, "
                f"{self._held.total()} altogether.",
                advice="Try again in a moment.",
            )

    def _leave(self, owner_id: str, turn: anyio.Event) -> None:
        """Give up waiting, or give the slot back if it was granted in the same moment."""
        if turn.is_set():
            self._release(owner_id)
            return
        queue = self._waiting[owner_id]
        queue.remove(turn)
        if not queue:
            del self._waiting[owner_id]

    def _release(self, owner_id: str) -> None:
        self._held[owner_id] -= 1
        if not self._held[owner_id]:
            del self._held[owner_id]
        self._grant()

    def _grant(self) -> None:
        """Give free slots to those who wait, one owner after the other."""
        while self._held.total() < self.total:
            owner_id = next((each for each in self._waiting if self._held[each] < self.per_owner), None)
            if owner_id is None:
                return
            queue = self._waiting[owner_id]
            queue.popleft().set()
            self._held[owner_id] += 1
            if queue:
                self._waiting.move_to_end(owner_id)
            else:
                del self._waiting[owner_id]
