"""Repeat an operation while the store or the record does not answer, up to a time limit."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from meshdeform.errors import UnavailableError

T = TypeVar("T")
RETRY_FOR_S = 600.0
"""Maximum seconds of an outage before an attempt leaves its job to another one."""
_FIRST_S, _LONGEST_S = 0.1, 2.0
_log = logging.getLogger(__name__)


class Retry:
    """Retries of operations that raise `UnavailableError`, each for at most `limit_s` seconds.

    `between` is called before each retry; it ends the retries by an exception if the lease is lost or the job canceled.
    """

    def __init__(self, between: Callable[[], None], limit_s: float = RETRY_FOR_S) -> None:
        self._between, self._limit_s = between, limit_s

    def until_answered(self, what: str, action: Callable[[], T]) -> T:
        """Call a repeatable `action` until it does not raise `UnavailableError`, and return its result.

        `what` describes the action for the log. `UnavailableError`: the time limit is exceeded.
        """
        end, delay = time.monotonic() + self._limit_s, _FIRST_S
        while True:
            try:
                return action()
            except UnavailableError as error:
                if time.monotonic() + delay > end:
                    raise
                _log.warning("%s: %s Retrying.", what, error.detail)
            time.sleep(delay)
            self._between()
            delay = min(2 * delay, _LONGEST_S)
