"""Decide which requests to retry, and when."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import httpx

from meshdeform.client.problems import WaitTimeoutError, retry_after_s, unreachable
from meshdeform.client.requests import Answer
from meshdeform.errors import IdempotencyBusyError, MeshdeformError, UnavailableError

_AGAIN = frozenset({408, 429, 502, 503, 504})

# Errors that a retry cannot fix.
_NOT_WORTH_A_RETRY = (httpx.UnsupportedProtocol, httpx.LocalProtocolError, httpx.DecodingError, httpx.TooManyRedirects)


@dataclass(frozen=True)
class Policy:
    """The timeouts and retries of a client."""

    timeout_s: float = 60.0
    """Seconds to wait for data of a response, and for which to retry a request after its first failure."""
    max_retries: int = 4
    """How often to retry a request. 0: never."""
    reconnect_s: float = 300.0
    """Seconds for which a stream of events, or a wait, tolerates a service that does not answer."""
    silence_s: float = 45.0
    """Seconds for which a stream of events may be silent. The service sends something every 15 seconds."""
    busy_s: float = 150.0
    """Seconds to wait for an earlier request with the same key. After a crash, the service releases the key by then."""
    upload_above: int = 2**20
    """Files with more bytes are uploaded before their job is posted, in pieces that can be resumed."""
    first_piece_bytes: int = 64 * 2**10  # size of the first piece; of a fast line each is twice the one before
    piece_bytes: int = 8 * 2**20  # largest size of these pieces
    # First and longest pause between retries. Pauses double in between.
    first_pause_s: float = 0.25
    longest_pause_s: float = 8.0
    chance: Callable[[], float] = field(default=random.random, repr=False)
    """Returns random numbers in 0..1, so that clients that failed together do not retry together."""

    @classmethod
    def of(cls, timeout_s: float, max_retries: int) -> Policy:
        """Return the policy of a client."""
        if max_retries < 0:
            raise ValueError(f"max_retries must be 0 or more, not {max_retries!r}.")
        return cls(timeout_s, max_retries, reconnect_s=5.0 * timeout_s)


class Patience:
    """Counts consecutive failures and computes the pause after each.

    Parameters
    ----------
    retries : int, optional
        Number of retries; None: unlimited.
    seconds : float
        Seconds after the first failure for which to retry.
    """

    def __init__(self, policy: Policy, *, retries: int | None, seconds: float) -> None:
        self._policy, self._retries, self._seconds = policy, retries, seconds
        self._failures, self._since = 0, 0.0

    def renew(self) -> None:
        """Reset the failures after progress."""
        self._failures = 0

    def alive(self) -> None:
        """Restart the time limit: the service answers, though without success yet."""
        self._since = time.monotonic()

    def pause(self, error: MeshdeformError) -> float:
        """Return the seconds to wait after a failure."""
        now = time.monotonic()
        if not self._failures:
            self._since = now
        self._failures += 1
        if self._retries is not None and self._failures > self._retries:
            raise error
        policy = self._policy
        pause = min(policy.first_pause_s * 2.0 ** min(self._failures - 1, 30), policy.longest_pause_s)
        pause *= 0.5 + 0.5 * policy.chance()
        if error.retry_after_s is not None:
            # Wait at least as long as the service requests, plus jitter.
            pause = error.retry_after_s + 0.25 * pause
        if now + pause > self._since + self._seconds:
            raise error
        return pause


def worth_a_retry(error: MeshdeformError) -> bool:
    """Return whether the same request may succeed later."""
    return error.status in _AGAIN or isinstance(error, IdempotencyBusyError)


def unanswered(failure: httpx.HTTPError, url: str) -> UnavailableError:
    """Return the error of a request without a response."""
    error = unreachable(failure, url)
    if isinstance(failure, _NOT_WORTH_A_RETRY):
        raise error from failure
    return error


def left_s(deadline: float | None, job_id: str) -> float:
    """Return the seconds until a deadline, in the time of the monotonic clock; without one, infinity."""
    left = math.inf if deadline is None else deadline - time.monotonic()
    if left <= 0.0:
        raise WaitTimeoutError(f"The job {job_id} has not finished in time.", job_id=job_id)
    return left


def pace(answer: Answer, default: float, least: float, most: float) -> float:
    """Return the seconds until the next poll, within bounds."""
    requested_s = retry_after_s(answer)
    return min(max(default if requested_s is None else requested_s, least), most)
