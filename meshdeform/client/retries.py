"""Which requests are sent again, and when."""

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

# What will be wrong the next time, too.
NOT_WORTH_A_RETRY = (httpx.UnsupportedProtocol, httpx.LocalProtocolError, httpx.DecodingError, httpx.TooManyRedirects)


@dataclass(frozen=True)
class Policy:
    """How patient a client is.

    Attributes
    ----------
    timeout_s : float
        How long one answer may be silent, and how long after its first failure a request may be sent again.
    max_retries : int
        How often a request is sent again. 0: never.
    reconnect_s : float
        How long a stream of events, or a wait, puts up with a service that does not answer.
    silence_s : float
        How long a stream of events may be silent; the service says something every 15 seconds.
    upload_above : int
        Files of more bytes are sent ahead of their job, in pieces that can go on where they broke off.
    held_s : float
        How long to wait for the first request of a key: a service that died with it gives the key free after that.
    first_pause_s, longest_pause_s : float
        The pauses double from the one to the other.
    chance : callable
        Gives numbers from 0 to 1: clients that failed together should not come back together.
    """

    timeout_s: float = 60.0
    max_retries: int = 4
    reconnect_s: float = 300.0
    silence_s: float = 45.0
    held_s: float = 150.0
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
    """Counts failures in a row and says how long to wait after each.

    Parameters
    ----------
    policy : Policy
    retries : int, optional
        How many failures to bear; None: any number.
    seconds : float
        How long after the first of them to go on trying.
    """

    def __init__(self, policy: Policy, *, retries: int | None, seconds: float) -> None:
        self._policy, self._retries, self._seconds = policy, retries, seconds
        self._failures, self._since = 0, 0.0

    def renew(self) -> None:
        """Forget the failures: something came."""
        self._failures = 0

    def alive(self) -> None:
        """Begin the time anew: the service answers, though it is no success yet."""
        self._since = time.monotonic()

    def pause(self, error: MeshdeformError) -> float:
        """Return the seconds to wait after a failure.

        Raises
        ------
        MeshdeformError
            The failure: the patience is at its end, or would be before the service wants to be asked again.
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
            # Not before the service said, and not all at that very moment.
            pause = error.retry_after_s + 0.25 * pause
        if now + pause > self._since + self._seconds:
            raise error
        return pause


def worth_a_retry(error: MeshdeformError) -> bool:
    """Whether the same request may well succeed a little later."""
    return error.status in _AGAIN or isinstance(error, IdempotencyBusyError)


def answered(call: Call, policy: Policy, patience: Patience | None = None) -> Operation[Answer]:
    """Send a request until there is an answer to it. It must be one that may be sent twice.

    Raises
    ------
    MeshdeformError
        What the service answered; `UnavailableError` where it did not.
    """
    patience = patience or Patience(policy, retries=policy.max_retries, seconds=policy.timeout_s)
    busy = Patience(policy, retries=None if policy.max_retries else 0, seconds=policy.held_s)
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
                return answer  # the first one came through, its answer did not
            error = error_of(answer)
            if not worth_a_retry(error):
                raise error
        yield Pause((busy if isinstance(error, IdempotencyBusyError) else patience).pause(error))


def pace(answer: Answer, default: float, least: float, most: float) -> float:
    """Return the seconds after which an answer wants to be asked for again."""
    wanted = retry_after_s(answer)
    return min(max(default if wanted is None else wanted, least), most)
