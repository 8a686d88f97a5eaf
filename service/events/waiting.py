"""Wait for the end of a job (`Prefer: wait=N`), without holding a thread."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Annotated

import anyio
from anyio import CancelScope
from fastapi import Header, Request

from meshdeform.api.limits import MAX_WAIT_S
from meshdeform.errors import LimitError, UnavailableError
from meshdeform.record.events import Head
from meshdeform.record.models import Job
from service.state import AppState

__all__ = ["Prefer", "applied", "preferred_wait", "settled", "wait_here"]


async def settled(
    app: AppState, job_id: str, owner: str | None, wait_s: float, *, request: Request | None = None
) -> Job:
    """Return a job once it has finished, or earlier on timeout, on disconnection, or if no slot is free.

    Parameters
    ----------
    app : AppState
    job_id : str
    owner : str or None
        Required owner of the job; None: any.
    wait_s : float
    request : Request, optional
        The waiting request, its body already read. Its slot is freed when the client disconnects.

    Raises
    ------
    NotFoundError
        The job does not exist, or was deleted meanwhile.
    UnavailableError
        The record does not respond at the start. Later, the job is returned as last read.
    """
    job = await app.waiters.read(app.record.get, job_id, owner)
    if job.state.terminal or wait_s <= 0:
        return job
    # If no slot is free, respond at once: waiting is only a preference.
    with suppress(LimitError):
        await wait_here(app, job_id, owner, _over, wait_s, request=request)
    try:
        return await app.waiters.read(app.record.get, job_id, owner)
    except UnavailableError:
        return job


async def wait_here(
    app: AppState,
    job_id: str,
    owner: str | None,
    wanted: Callable[[Head | None], bool],
    wait_s: float,
    *,
    request: Request | None = None,
) -> None:
    """Hold a slot until a job meets a condition, the time is up, or the client disconnects.

    Raises
    ------
    LimitError
        No slot is free.
    """
    with app.waiters.slot(owner or ""):
        async with anyio.create_task_group() as group:
            if request is not None:
                group.start_soon(_cancel_when_gone, request, group.cancel_scope)
            await app.waiters.until(job_id, wanted, wait_s)
            group.cancel_scope.cancel()


def _over(head: Head | None) -> bool:
    return head is None or head.state.terminal


async def _cancel_when_gone(request: Request, waiting: CancelScope) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
    waiting.cancel()


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
