"""Return the events of a job as server-sent events or as pages of JSON.

Source: the HTML standard, "Server-sent events". A client that reconnects sends the number of its last event
(`Last-Event-ID`) and gets the events after it, without gaps or duplicates.
"""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import anyio
from fastapi import APIRouter, Depends, Header, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from meshdeform.api.jobs import EventList, EventView
from meshdeform.errors import LimitError, NotFoundError, ParameterError, UnavailableError
from meshdeform.record.changes import JobPosition
from meshdeform.record.models import Event
from service.documentation.responses import WAITED, JobId
from service.events.waiting import JobWaiters, Prefer, applied, preferred_wait, wait_here
from service.http.auth import Gate
from service.http.errors import KNOWN_QUERY, problem_responses
from service.http.links import ViewerDep, still_opens
from service.state import AppState, AppStateDep

if TYPE_CHECKING:
    from starlette.types import Message, Receive, Scope, Send

MAX_EVENTS = 1000
_MAX_SEQ = 2**31 - 1  # the record's largest integer
_STREAM = "text/event-stream"
_BATCH = 100
_SILENCE_S = 15.0  # proxies close silent connections
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
    """A stream that holds a slot until its client disconnects or stops reading."""

    media_type = _STREAM

    def __init__(self, waiters: JobWaiters, owner: str, content: AsyncIterator[str]) -> None:
        super().__init__(content, headers=_HEADERS)
        self._waiters, self._owner = waiters, owner

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def sent_in_time(message: Message) -> None:
            with anyio.fail_after(_STUCK_S):
                await send(message)

        with self._waiters.slot(self._owner), suppress(TimeoutError):
            await super().__call__(scope, receive, sent_in_time)


@dataclass
class _Wanted:
    """Which events are wanted, and how."""

    after: Annotated[
        int, Query(description="Number of the last event that you received.", ge=0, le=_MAX_SEQ, examples=[0])
    ] = 0
    limit: Annotated[
        int, Query(description="Maximum number of events in a JSON page.", ge=1, le=MAX_EVENTS, examples=[100])
    ] = MAX_EVENTS
    format_: Annotated[
        Literal["json", "stream"] | None,
        Query(
            alias="format",
            description="Response format; overrides `Accept`. Default: a stream if `Accept` contains "
            "text/event-stream, otherwise JSON.",
            examples=["json"],
        ),
    ] = None
    last_event_id: Annotated[
        int | None,
        Header(
            alias="Last-Event-ID",
            description="Overrides `after`. Event stream clients send it when they reconnect. Default: none.",
            ge=0,
            le=_MAX_SEQ,
            examples=[3],
        ),
    ] = None
    prefer: Prefer = None  # read from the request, which may contain it more than once

    @property
    def since(self) -> int:
        """The number of the last event that the client has."""
        return self.after if self.last_event_id is None else self.last_event_id


@router.get(
    "",
    summary="Follow a job",
    response_class=JSONResponse,
    responses={
        200: {
            "model": EventList,
            "description": "The events after `after`. A stream continues with new events until the job has finished.",
            "headers": WAITED,
            "content": {_STREAM: {"schema": {"type": "string"}, "example": _EXAMPLE}},
        },
        204: {"description": "The job has finished and the client has all its events; there will be no more."},
        **problem_responses(NotFoundError, ParameterError, LimitError, UnavailableError),
    },
)
async def get_events(
    request: Request,
    app: AppStateDep,
    viewer: ViewerDep,
    id: JobId,
    wanted: Annotated[_Wanted, Depends()],
) -> Response:
    """A stream ends with the job's final event. For JSON, `Prefer: wait=N` waits for events if there are none yet."""
    waiters, owner, after = app.waiters, viewer.owner_id, wanted.since
    if wanted.format_ == "json" or (wanted.format_ is None and not _wants_stream(request)):
        return await _page(request, app, id, owner, after, wanted.limit)
    # Read before the response starts, so that a missing job is a 404 and no stream.
    events, over = await waiters.read(_next_events, app, id, after, owner)
    if over:
        # Browsers reconnect after the end of a stream, until they get this.
        return Response(status_code=204, headers=_HEADERS)
    gate: Gate = request.app.state.gate

    def may_continue() -> Awaitable[bool]:
        return still_opens(app, id, viewer.link) if viewer.link else gate.is_still_valid(request)

    return _EventStream(waiters, viewer.slot, _stream(app, id, after, events, may_continue))


async def _page(request: Request, app: AppState, job_id: str, owner: str | None, after: int, limit: int) -> Response:
    # A link holds no connection of the owner's.
    wait_s = None if owner is None else preferred_wait(request)
    events = await app.waiters.read(app.record.events.after, job_id, after, limit, owner)
    if not events and wait_s is not None:
        with suppress(LimitError):
            await wait_here(app.waiters, job_id, owner, _more(after), wait_s, request=request)
        events = await app.waiters.read(app.record.events.after, job_id, after, limit, owner)
    page = EventList(events=[EventView.of(event) for event in events], next_after=events[-1].seq if events else after)
    return JSONResponse(page.model_dump(mode="json"), headers={**_HEADERS, **applied(wait_s), "Vary": "Accept"})


async def _stream(
    app: AppState, job_id: str, after: int, events: list[Event], may_continue: Callable[[], Awaitable[bool]]
) -> AsyncIterator[str]:
    waiters, over = app.waiters, False
    yield f"retry: {_RETRY_MS}\n\n"
    while True:
        for event in events:
            yield f"id: {event.seq}\nevent: {event.type}\ndata: {EventView.of(event).model_dump_json()}\n\n"
            after, over = event.seq, event.type.terminal
        # If the process is ending, the client reconnects to another one, or to the next.
        if over or waiters.closing:
            return
        changed = len(events) == _BATCH or await waiters.until(job_id, _more(after), _SILENCE_S)
        if not await may_continue():
            return  # the key was revoked
        if not changed:
            events = []
            yield ": keep-alive\n\n"
            continue
        try:
            events, over = await waiters.read(_next_events, app, job_id, after)
        except NotFoundError:
            return
        except UnavailableError:
            events = []
            await anyio.sleep(_AWAY_S)


def _next_events(app: AppState, job_id: str, after: int, owner: str | None = None) -> tuple[list[Event], bool]:
    """Return the next events of a job; if there are none, also whether there will be no more."""
    if events := app.record.events.after(job_id, after, _BATCH, owner):
        return events, False
    if not app.record.get(job_id, owner).state.terminal:
        return [], False
    # The job may have finished between the two queries.
    events = app.record.events.after(job_id, after, _BATCH, owner)
    return events, not events


def _more(after: int) -> Callable[[JobPosition | None], bool]:
    return lambda head: head is None or head.seq > after or head.state.terminal


def _wants_stream(request: Request) -> bool:
    """Return whether `Accept` prefers the stream to JSON."""
    qualities: dict[str, float] = {}
    for entry in ",".join(request.headers.getlist("accept")).split(","):
        kind, _, parameters = entry.partition(";")
        quality = _QUALITY.search(parameters)
        qualities[kind.strip().lower()] = float(quality[1]) if quality else 1.0
    return qualities.get(_STREAM, 0.0) > 0.0 and qualities[_STREAM] >= qualities.get("application/json", 0.0)
