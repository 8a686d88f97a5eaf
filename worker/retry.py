"""Ask the store or the record again when it does not answer, for as long as that makes sense."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from meshdeform.errors import UnavailableError

__all__ = ["RETRY_FOR_S", "Retry"]

T = TypeVar("T")
_log = logging.getLogger(__name__)

RETRY_FOR_S = 600.0
"""How long an outage may last before an attempt leaves its job to another one."""

_FIRST_S, _LONGEST_S = 0.1, 2.0


class Retry:
    """Repeat what failed because something did not answer.

    Parameters
    ----------
    between : callable
        Called before each new try; raises what ends the tries: the lease is lost, the job is canceled.
    limit_s : float
        How long one thing is tried.
    """

    def __init__(self, between: Callable[[], None], limit_s: float = RETRY_FOR_S) -> None:
        self._between, self._limit_s = between, limit_s

    def until_answered(self, what: str, action: Callable[[], T]) -> T:
        """Return what `action` returns, once it does.

        Parameters
        ----------
        what : str
            The action, for the log.
        action : callable
            May be repeated.

        Raises
        ------
        UnavailableError
            The time is over.
        """
        end, delay = time.monotonic() + self._limit_s, _FIRST_S
        while True:
            try:
                return action()
            except UnavailableError as error:
                if time.monotonic() + delay > end:
                    raise
                _log.warning("%s: %s Trying again.", what, error.detail)
            time.sleep(delay)
            self._between()
            delay = min(2 * delay, _LONGEST_S)
