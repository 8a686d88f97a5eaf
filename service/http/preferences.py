"""`Prefer: wait=N`: a request that would rather wait for the end of its job than look again and again.

Source: RFC 7240, section 4.3.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated

from fastapi import Header, Request

from meshdeform.api.limits import MAX_WAIT_S

__all__ = ["Prefer", "applied", "preferred_wait"]

_WAIT = re.compile(r'wait\s*=\s*"?(\d{1,9})"?\s*(?:;.*)?', re.IGNORECASE)

Prefer = Annotated[
    str | None,
    Header(
        description=f"`wait=N`: hold the answer back until the job is over, at most N seconds (1 to {MAX_WAIT_S}). "
        "Default: answer at once.",
        max_length=200,
        examples=["wait=30"],
    ),
]


def preferred_wait(request: Request) -> int | None:
    """Return how many seconds a request would wait; None where it says nothing that is understood.

    More than we wait for is cut to that: a preference is no demand, and the answer says what was done.
    """
    return _wait(request.headers.getlist("prefer"))


def applied(wait_s: int | None) -> dict[str, str]:
    """Return the header that says that it was done."""
    return {} if wait_s is None else {"Preference-Applied": f"wait={wait_s}"}


def _wait(headers: Sequence[str]) -> int | None:
    for preference in ",".join(headers).split(","):
        # The first one counts, as the RFC has it.
        if match := _WAIT.fullmatch(preference.strip()):
            return min(int(match[1]), MAX_WAIT_S) or None
    return None
