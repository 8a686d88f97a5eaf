"""Wait for the end of a job: `Prefer: wait=N`. No thread is held meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import anyio
from anyio import CancelScope
from fastapi import Request

from meshdeform.errors import LimitError, UnavailableError
from meshdeform.record.events import Head
from meshdeform.record.models import Job
from service.state import Parts

__all__ = ["settled", "wait_here"]


async def settled(
    parts: Parts, job_id: str, owner: str | None, wait_s: float, *, request: Request | None = None
) -> Job:
    """Return a job once it is over, or as it is when the time is up, the client goes away, or no place is left.

    Parameters
    ----------
    parts : Parts
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
    job = await parts.hub.read(parts.record.get, job_id, owner)
    if job.state.terminal or wait_s <= 0:
        return job
    # Where there is no place left the answer comes at once: waiting was only preferred.
    with suppress(LimitError):
        await wait_here(parts, job_id, owner, _over, wait_s, request=request)
    try:
        return await parts.hub.read(parts.record.get, job_id, owner)
    except UnavailableError:
        return job


async def wait_here(
    parts: Parts,
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
    with parts.hub.place(owner or ""):
        async with anyio.create_task_group() as group:
            if request is not None:
                group.start_soon(_cancel_when_gone, request, group.cancel_scope)
            await parts.hub.until(job_id, wanted, wait_s)
            group.cancel_scope.cancel()


def _over(head: Head | None) -> bool:
    return head is None or head.state.terminal


async def _cancel_when_gone(request: Request, waiting: CancelScope) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
    waiting.cancel()
