"""Wait for the end of a job: `Prefer: wait=N`. No thread is held meanwhile."""

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
    """Return a job once it is over, or as it is when the time is up, the client goes away, or no place is left.

    Parameters
    ----------
    app : AppState
    job_id : str
    owner : str or None
        Whose it must be; None: anybody's.
    wait_s : float
    request : Request, optional
        The one that waits, its body read: its place is free as soon as its client goes away.

    Raises
    ------
    NotFoundError
        There is no such job, or it was deleted meanwhile.
    UnavailableError
        The record does not answer at the beginning. Later on the job is returned as it was last seen.
    """
    job = await app.waiters.read(app.record.get, job_id, owner)
    if job.state.terminal or wait_s <= 0:
        return job
    # Where there is no place left the answer comes at once: waiting was only preferred.
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
    """Hold a place until a job is where it is wanted, the time is up, or the client goes away.

    Raises
    ------
    LimitError
        No place is left.
    """
    with app.waiters.place(owner or ""):
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
