"""Limit the request rate of each key with a leaky bucket in Redis, shared by all API processes.

The generic cell rate algorithm stores one number per key: the time at which its bucket will be empty. While Redis is
unavailable, each process limits with buckets of its own.

Source: ITU-T I.371, annex A (the algorithm); draft-ietf-httpapi-ratelimit-headers (the headers).
"""

from __future__ import annotations

import logging
import math
import threading
import time
from dataclasses import dataclass

from redis import Redis
from redis.backoff import NoBackoff
from redis.exceptions import RedisError
from redis.retry import Retry

__all__ = ["Buckets", "Rate", "RateLimiter", "Verdict"]

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
class Verdict:
    """The state of a bucket after a request.

    Attributes
    ----------
    wait_s : float
        0 if the request is allowed; otherwise the seconds until one is.
    remaining : int
        Number of further requests that are allowed now.
    reset_s : int
        Seconds until the bucket is empty, when a whole burst is allowed.
    """

    wait_s: float
    remaining: int
    reset_s: int


class Buckets:
    """Buckets of this process, by name. Thread-safe."""

    def __init__(self) -> None:
        self._empty_at: dict[str, float] = {}
        self._lock = threading.Lock()

    def take(self, name: str, rate: Rate, now: float | None = None) -> Verdict:
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

    Parameters
    ----------
    redis_url : str
    prefix : str
        Prefix of the names in Redis: different for deployments that share a Redis.
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

    def take(self, name: str, per_minute: int) -> Verdict:
        """Count one request against a name. Never raises, and never waits long."""
        rate = Rate.of(per_minute)
        if time.monotonic() < self._away_until:
            return self._local.take(name, rate)
        try:
            wait_s, level_s = self._take(keys=[f"{self._prefix}:rate:{name}"], args=[rate.interval_s, rate.burst])
        except RedisError as error:
            if self._away_until == -math.inf:
                _log.warning("Redis does not respond (%s): rate limits are per process", type(error).__name__)
            self._away_until = time.monotonic() + _REDIS_PAUSE_S
            return self._local.take(name, rate)
        self._away_until = -math.inf
        return _verdict(rate, float(wait_s), float(level_s))

    def close(self) -> None:
        """Close the connections."""
        self._redis.close()


def _verdict(rate: Rate, wait_s: float, level_s: float) -> Verdict:
    remaining = 0 if wait_s else math.floor(rate.burst - level_s / rate.interval_s + 1e-6)
    return Verdict(wait_s, max(0, remaining), math.ceil(level_s))
