"""Stop work for whoever has gone."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from anyio import CancelScope
from fastapi import Request

from meshdeform.children.asking import ended_with
from meshdeform.children.warm import Asked
from meshdeform.errors import UnavailableError

__all__ = ["while_waited_for"]


@asynccontextmanager
async def while_waited_for(request: Request) -> AsyncIterator[Asked]:
    """Take back what is asked within when the caller goes; child processes end, and turns are not waited for.

    The body must have been received. UnavailableError: the caller has gone.
    """
    asked = Asked()
    with CancelScope() as waiting:
        watching = asyncio.create_task(_stop_when_gone(request, asked, waiting))
        try:
            with ended_with(lambda: asked.stopped):
                yield asked
        finally:
            watching.cancel()
    if asked.stopped:
        raise UnavailableError("The caller has gone.")


async def _stop_when_gone(request: Request, asked: Asked, waiting: CancelScope) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
    asked.stop()
    waiting.cancel()  # where it waits for its turn
