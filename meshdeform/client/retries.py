"""Decide which requests to retry, and when."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import httpx

from meshdeform.client.commands import Answer, Call, Operation, Pause, Send
from meshdeform.client.problems import error_of, retry_after_s, unreachable
from meshdeform.errors import IdempotencyBusyError, MeshdeformError

__all__ = ["NOT_WORTH_A_RETRY", "Patience", "Policy", "answered", "pace", "worth_a_retry"]

_AGAIN = frozenset({408, 429, 502, 503, 504})

# Errors that a retry cannot fix.
NOT_WORTH_A_RETRY = (httpx.UnsupportedProtocol, httpx.LocalProtocolError, httpx.DecodingError, httpx.TooManyRedirects)


@dataclass(frozen=True)
class Policy:
    """The timeouts and retries of a client.

    Attributes
    ----------
    timeout_s : float
        Seconds to wait for data of a response, and for which to retry a request after its first failure.
    max_retries : int
        How often to retry a request. 0: never.
    reconnect_s : float
        Seconds for which a stream of events, or a wait, tolerates a service that does not answer.
    silence_s : float
        Seconds for which a stream of events may be silent. The service sends something every 15 seconds.
    upload_above : int
        Files with more bytes are uploaded before their job is posted, in pieces that can be resumed.
    busy_s : float
        Seconds to wait for an earlier request with the same key. After a crash, the service releases the key by then.
    first_pause_s, longest_pause_s : float
        First and longest pause between retries. Pauses double in between.
    chance : callable
        Returns random numbers in 0..1, so that clients that failed together do not retry together.
    """

    timeout_s: float = 60.0
    max_retries: int = 4
    reconnect_s: float = 300.0
    silence_s: float = 45.0
    busy_s: float = 150.0
    upload_above: int = 16 * 2**20
    first_pause_s: float = 0.25
    longest_pause_s: float = 8.0
    chance: Callable[[], float] = field(default=random.random, repr=False)

    @classmethod
    def of(cls, timeout_s: float, max_retries: int) -> Policy:
        """Return the policy of a client.

        Raises
        ------
        ValueError
            `max_retries` is below 0.
        """
        if max_retries < 0:
            raise ValueError(f"max_retries must be 0 or more, not {max_retries!r}.")
        return cls(timeout_s, max_retries, reconnect_s=5.0 * timeout_s)


class Patience:
    """Counts consecutive failures and computes the pause after each.

    Parameters
    ----------
    policy : Policy
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
        """Return the seconds to wait after a failure.

        Raises
        ------
        MeshdeformError
            The given error, if retries or time are exhausted, or the service's `Retry-After` exceeds the time left.
        """
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


def answered(call: Call, policy: Policy, patience: Patience | None = None) -> Operation[Answer]:
    """Send a request, with retries, and return the response. It must be safe to send more than once.

    Raises
    ------
    MeshdeformError
        The service's error; `UnavailableError` if it did not answer.
    """
    patience = patience or Patience(policy, retries=policy.max_retries, seconds=policy.timeout_s)
    busy = Patience(policy, retries=None if policy.max_retries else 0, seconds=policy.busy_s)
    lost = False
    while True:
        error: MeshdeformError
        try:
            answer: Answer = yield Send(call)
        except httpx.HTTPError as failure:
            error, lost = unreachable(failure, call.url), True
            if isinstance(failure, NOT_WORTH_A_RETRY):
                raise error from failure
        else:
            if answer.ok:
                return answer
            if lost and call.method == "DELETE" and answer.status == 404:
                return answer  # the first request succeeded, but its response was lost
            error = error_of(answer)
            if not worth_a_retry(error):
                raise error
        yield Pause((busy if isinstance(error, IdempotencyBusyError) else patience).pause(error))


def pace(answer: Answer, default: float, least: float, most: float) -> float:
    """Return the seconds until the next poll, within bounds."""
    wanted = retry_after_s(answer)
    return min(max(default if wanted is None else wanted, least), most)
