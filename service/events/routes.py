"""What happens to a job: as a stream of server-sent events, or in pages of JSON.

Source: the HTML standard, "Server-sent events". A reader that comes back names the last event that it has
(`Last-Event-ID`) and gets what follows: nothing twice, nothing left out.
"""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated, Literal

import anyio
from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from meshdeform.api.jobs import EventList, EventView
from meshdeform.errors import LimitError, NotFoundError, ParameterError, UnavailableError
from meshdeform.record.events import Head
from meshdeform.record.models import Event
from service.documentation.responses import WAITED, JobId
from service.events.broker import JobWaiters
from service.events.waiting import Prefer, applied, preferred_wait, wait_here
from service.http.auth import PrincipalDep
from service.http.errors import problem_responses
from service.http.queries import KNOWN_QUERY
from service.state import AppState, AppStateDep

if TYPE_CHECKING:
    from starlette.types import Message, Receive, Scope, Send

__all__ = ["MAX_EVENTS", "router"]

MAX_EVENTS = 1000
_MAX_SEQ = 2**31 - 1  # as large as the record can count
_STREAM = "text/event-stream"
_BATCH = 100
_SILENCE_S = 15.0  # proxies drop a connection on which nothing comes
_STUCK_S = 60.0
_AWAY_S = 1.0
_RETRY_MS = 2000
_HEADERS = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
_QUALITY = re.compile(r"q\s*=\s*([01](?:\.\d{0,3})?)", re.IGNORECASE)
_EXAMPLE = (
    f"retry: {_RETRY_MS}\n\n"
    "id: 1\nevent: queued\n"
    'data: {"seq":1,"job_id":"job_01kg9zqk2xf3v8c5m7n9p1r4t6","type":"queued","at":"2026-01-31T12:00:00Z",'
    '"attempt":0,"data":{"reason":"created"}}\n\n'
)
router = APIRouter(prefix="/v1/jobs/{id}/events", tags=["events"], dependencies=KNOWN_QUERY)


class _EventStream(StreamingResponse):
    """A stream that holds a place, and gives it back when its reader goes away or stands still."""

    media_type = _STREAM

    def __init__(self, waiters: JobWaiters, owner: str, content: AsyncIterator[str]) -> None:
        super().__init__(content, headers=_HEADERS)
        self._hub, self._owner = waiters, owner

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def sent_in_time(message: Message) -> None:
            with anyio.fail_after(_STUCK_S):
                await send(message)

        with self._hub.place(self._owner), suppress(TimeoutError):
            await super().__call__(scope, receive, sent_in_time)


@router.get(
    "",
    operation_id="get_events",
    summary="Follow a job",
    response_class=JSONResponse,
    responses={
        200: {
            "model": EventList,
            "description": "The events after `after`; as a stream also those to come, until the one that ends the job.",
            "headers": WAITED,
            "content": {_STREAM: {"schema": {"type": "string"}, "example": _EXAMPLE}},
        },
        204: {"description": "The job is over and its stream was read to the end: nothing will come any more."},
        **problem_responses(NotFoundError, ParameterError, LimitError, UnavailableError),
    },
)
async def get_events(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    id: JobId,  # noqa: A002 - the path's own word
    after: Annotated[
        int, Query(description="Number of the last event that you have.", ge=0, le=_MAX_SEQ, examples=[0])
    ] = 0,
    limit: Annotated[
        int, Query(description="Length of a page, as JSON.", ge=1, le=MAX_EVENTS, examples=[100])
    ] = MAX_EVENTS,
    format_: Annotated[
        Literal["json", "stream"] | None,
        Query(
            alias="format",
            description="What to get, whatever `Accept` says. Default: a stream where `Accept` names "
            "text/event-stream, else JSON.",
            examples=["json"],
        ),
    ] = None,
    last_event_id: Annotated[
        int | None,
        Header(
            alias="Last-Event-ID",
            description="As `after`, and goes before it: readers of streams send it when they connect again. "
            "Default: none.",
            ge=0,
            le=_MAX_SEQ,
            examples=[3],
        ),
    ] = None,
    prefer: Prefer = None,  # noqa: ARG001 - read from the request, where it may come more than once
) -> Response:
    """A stream ends with the event that ends the job. As JSON, `Prefer: wait=N` holds an empty page back."""
    waiters, owner = app.waiters, principal.owner_id
    after = after if last_event_id is None else last_event_id
    if format_ == "json" or (format_ is None and not _wants_stream(request)):
        return await _page(request, app, id, owner, after, limit)
    # Read before the answer begins, so that a job which is not there is a problem and no stream.
    found, over = await waiters.read(_look, app, id, after, owner)
    if over:
        # A browser connects again after every end of a stream, until it gets this.
        return Response(status_code=204, headers=_HEADERS)
    return _EventStream(waiters, owner, _stream(app, id, after, found))


async def _page(request: Request, app: AppState, job_id: str, owner: str, after: int, limit: int) -> Response:
    wait_s = preferred_wait(request)
    found = await app.waiters.read(app.record.events.after, job_id, after, limit, owner)
    if not found and wait_s is not None:
        with suppress(LimitError):
            await wait_here(app, job_id, owner, _more(after), wait_s, request=request)
        found = await app.waiters.read(app.record.events.after, job_id, after, limit, owner)
    page = EventList(events=[EventView.of(event) for event in found], next_after=found[-1].seq if found else after)
    return JSONResponse(page.model_dump(mode="json"), headers={**_HEADERS, **applied(wait_s), "Vary": "Accept"})


async def _stream(app: AppState, job_id: str, after: int, found: list[Event]) -> AsyncIterator[str]:
    waiters, over = app.waiters, False
    yield f"retry: {_RETRY_MS}\n\n"
    while True:
        for event in found:
            yield _written(event)
            after, over = event.seq, event.type.terminal
        # Where the process ends, the reader connects again and goes on with another process, or with the next one.
        if over or waiters.closing:
            return
        if len(found) < _BATCH and not await waiters.until(job_id, _more(after), _SILENCE_S):
            found = []
            yield ": nothing new\n\n"
            continue
        try:
            found, over = await waiters.read(_look, app, job_id, after)
        except NotFoundError:
            return
        except UnavailableError:
            found = []
            await anyio.sleep(_AWAY_S)


def _look(app: AppState, job_id: str, after: int, owner: str | None = None) -> tuple[list[Event], bool]:
    """The next events of a job; without any, whether none can come any more."""
    if found := app.record.events.after(job_id, after, _BATCH, owner):
        return found, False
    if not app.record.get(job_id, owner).state.terminal:
        return [], False
    # It may have come to its end between the two looks.
    found = app.record.events.after(job_id, after, _BATCH, owner)
    return found, not found


def _more(after: int) -> Callable[[Head | None], bool]:
    return lambda head: head is None or head.seq > after or head.state.terminal


def _written(event: Event) -> str:
    return f"id: {event.seq}\nevent: {event.type}\ndata: {EventView.of(event).model_dump_json()}\n\n"


def _wants_stream(request: Request) -> bool:
    """Whether `Accept` names the stream, and nothing that it would rather have."""
    wanted: dict[str, float] = {}
    for entry in ",".join(request.headers.getlist("accept")).split(","):
        kind, _, parameters = entry.partition(";")
        quality = _QUALITY.search(parameters)
        wanted[kind.strip().lower()] = float(quality[1]) if quality else 1.0
    return wanted.get(_STREAM, 0.0) > 0.0 and wanted[_STREAM] >= wanted.get("application/json", 0.0)
