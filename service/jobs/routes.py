"""List, read, cancel and delete jobs. `creation_routes` creates them."""

from __future__ import annotations

import contextlib
import logging
import re
from dataclasses import dataclass
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Depends, Header, Query, Request, Response
from fastapi.responses import JSONResponse
from pydantic import AwareDatetime, BeforeValidator

from meshdeform.api.jobs import JobList, JobView, SignedUrl, job_headers
from meshdeform.api.limits import MAX_PAGE, MAX_SEARCH
from meshdeform.errors import ConflictError, NotFoundError, ParameterError, UnavailableError
from meshdeform.record.models import Job, JobState
from meshdeform.record.reconciler import remove_job
from meshdeform.requests.document import MAX_METADATA_ENTRIES, MAX_METADATA_NAME, MAX_METADATA_VALUE
from service.documentation.responses import CALLER_ERRORS, ETAG, RETRY_AFTER, WAITED, JobId
from service.downloads.responses import matches
from service.events.waiting import Prefer, applied, preferred_wait, settled
from service.http.auth import PrincipalDep
from service.http.errors import KNOWN_QUERY, answers, problem_responses
from service.http.links import ViewerDep, job_link
from service.state import AppStateDep

__all__ = ["JobId", "router", "shown"]

_log = logging.getLogger(__name__)
_LABEL = re.compile(r"metadata\[(.*)\]", re.DOTALL)
_METADATA = {
    "name": "metadata",
    "in": "query",
    "required": False,
    "style": "deepObject",
    "explode": True,
    "description": "Only jobs with all of these labels: `?metadata[shot]=sc010`. Default: all.",
    "schema": {
        "type": "object",
        "maxProperties": MAX_METADATA_ENTRIES,
        "propertyNames": {"minLength": 1, "maxLength": MAX_METADATA_NAME},
        "additionalProperties": {"type": "string", "maxLength": MAX_METADATA_VALUE},
    },
    "example": {"shot": "sc010"},
}
router = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=KNOWN_QUERY)


def _written_time(value: object) -> object:
    """Refuse bare numbers, which pydantic would take for seconds since 1970."""
    if isinstance(value, str) and "-" not in value[1:]:
        raise ValueError("it is no date and time such as 2026-01-31T12:00:00Z")
    return value


@dataclass
class _Asked:
    """Which jobs are listed; the request also names their labels."""

    request: Request
    state: Annotated[
        JobState | None, Query(description="Only jobs in this state. Default: all.", examples=["running"])
    ] = None
    error: Annotated[
        str | None,
        Query(
            description="Only jobs that failed with this error (its `code`). Default: all.",
            max_length=64,
            pattern="^[a-z_]+$",
            examples=["internal"],
        ),
    ] = None
    created_after: Annotated[
        Annotated[AwareDatetime, BeforeValidator(_written_time)] | None,
        Query(
            description="Only jobs created after this time, with its offset from UTC. Default: all.",
            examples=["2026-01-31T12:00:00Z"],
            json_schema_extra={"maxLength": 64},
        ),
    ] = None
    q: Annotated[
        str,
        Query(
            description="Only jobs whose prompts, file names or values of labels contain all of these words, in any "
            "order and case; parts of words count too. Default: all.",
            max_length=MAX_SEARCH,
            pattern=r"^[^\x00]*$",
            examples=["duck vase"],
        ),
    ] = ""
    limit: Annotated[int, Query(description="Jobs per page, at most.", ge=1, le=MAX_PAGE, examples=[50])] = 50
    cursor: Annotated[
        str | None,
        Query(
            description="`next_cursor` of the previous page. Default: the first page.",
            max_length=200,
            examples=["am9iXzAxa2c5enFrMnhmM3Y4YzVtN245cDFyNHQ2"],
        ),
    ] = None


@router.get(
    "",
    summary="List jobs, newest first",
    responses=answers(JobList, "A page of jobs.", ParameterError, *CALLER_ERRORS),
    openapi_extra={"parameters": [_METADATA]},
)
def list_jobs(
    app: AppStateDep,
    principal: PrincipalDep,
    asked: Annotated[_Asked, Depends()],
) -> Response:
    """Jobs that are created while you page through the list do not shift later pages."""
    page = app.record.list_jobs(
        asked.state,
        asked.cursor,
        asked.limit,
        owner=principal.owner_id,
        metadata=_labels(asked.request),
        created_after=asked.created_after,
        words=asked.q,
        error=asked.error,
    )
    return JSONResponse(JobList(jobs=[_view(job) for job in page.jobs], next_cursor=page.next_cursor).as_json())


@router.get(
    "/{id}",
    summary="Get a job",
    responses={
        200: {"model": JobView, "description": "The job.", "headers": {**ETAG, **RETRY_AFTER, **WAITED}},
        304: {"description": "Unchanged since the version in `If-None-Match`.", "headers": ETAG},
        **problem_responses(NotFoundError, *CALLER_ERRORS),
    },
)
async def get_job(
    request: Request,
    app: AppStateDep,
    viewer: ViewerDep,
    id: JobId,
    if_none_match: Annotated[
        str | None,
        Header(description="The `ETag` of your version. Default: none.", max_length=1000, examples=['W/"7"']),
    ] = None,
    prefer: Prefer = None,  # noqa: ARG001 - declared for OpenAPI; read from the request, since the header may be repeated
) -> Response:
    """If `If-None-Match` holds the current `ETag`, the answer is 304 without a body."""
    # A link holds no connection of the owner's.
    wait_s = None if viewer.link else preferred_wait(request)
    if wait_s is None or viewer.owner_id is None:
        job = await to_thread.run_sync(app.record.get, id, viewer.owner_id)
    else:
        job = await settled(app.waiters, app.record, id, viewer.owner_id, wait_s, request=request)
    if viewer.link:
        # Labels and other jobs are no part of what the owner has shown.
        document = _view(job).model_copy(update={"metadata": {}, "origin": None})
        return JSONResponse(document.as_json(), headers={**job_headers(job), "Cache-Control": "no-store"})
    headers = {**job_headers(job), **applied(wait_s)}
    if matches(if_none_match, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    return shown(job, headers=headers)


@router.post(
    "/{id}/cancel",
    summary="Cancel a job",
    responses=answers(
        JobView,
        "`canceled`, or `canceling` until its worker stops.",
        NotFoundError,
        ConflictError,
        *CALLER_ERRORS,
        headers=ETAG,
    ),
)
def cancel_job(app: AppStateDep, principal: PrincipalDep, id: JobId) -> Response:
    """A queued job is canceled at once, a running one after its current step. A job that ended otherwise gives 409."""
    try:
        job = app.record.request_cancel(id, principal.owner_id)
    except ConflictError:
        job = app.record.get(id, principal.owner_id)
        if job.state is not JobState.CANCELED:
            raise
        # Already canceled: repeating the request is not an error.
    if job.state is JobState.CANCELING:
        try:
            app.queue.publish_cancel(id)
        except UnavailableError as error:
            # The worker reads the record with every heartbeat, and stops a little later.
            _log.warning("job %s: its worker was not notified: %s", id, error)
    return shown(job)


@router.delete(
    "/{id}",
    summary="Delete a job and its artifacts",
    status_code=204,
    response_class=Response,
    responses=answers(None, "The job is deleted.", NotFoundError, ConflictError, *CALLER_ERRORS, status=204),
)
def delete_job(app: AppStateDep, principal: PrincipalDep, id: JobId) -> Response:
    """The job must have ended: cancel it first. Its files are deleted too, unless another job uses them."""
    files = app.record.delete(id, principal.owner_id)
    with contextlib.suppress(UnavailableError):
        # The record lists what is left to remove: if the store is unavailable now, the reconciler does it later.
        remove_job(app.record, app.store, id, files)
    return Response(status_code=204)


@router.post(
    "/{id}/url",
    summary="Create a link to a job",
    responses=answers(SignedUrl, "The address of the page that shows the job.", NotFoundError, *CALLER_ERRORS),
)
def link_job(app: AppStateDep, principal: PrincipalDep, id: JobId) -> Response:
    """Anyone who has the link can watch this one job, and read its asset, its checkpoints and its results.

    It changes nothing and opens no other job. It ends with its time, with the job, and with the API key that made it.
    """
    job = app.record.get(id, principal.owner_id)
    if app.settings.web == "off":
        raise NotFoundError(
            "This deployment serves no page that a link could open.",
            advice="Create signed URLs of single artifacts, or ask its operator for MESHDEFORM_WEB.",
        )
    link = job_link(app, job.id, principal.key_id)
    return JSONResponse(link.model_dump(mode="json"), headers={"Cache-Control": "no-store"})


def shown(job: Job, *, status: int = 200, headers: dict[str, str] | None = None) -> JSONResponse:
    """Return a response with a job as its body."""
    return JSONResponse(_view(job).as_json(), status, {**job_headers(job), **(headers or {})})


def _view(job: Job) -> JobView:
    """Return the document of a job as this server sees it."""
    return JobView.of(job).model_copy(update={"unreadable": job.unreadable})


def _labels(request: Request) -> dict[str, str]:
    """Return the labels in the query, in OpenAPI's notation for objects: `metadata[NAME]=VALUE`."""
    # `ParameterError`: a label is repeated, too long or not allowed, or there are too many.
    labels: dict[str, str] = {}
    for parameter, value in request.query_params.multi_items():
        match = _LABEL.fullmatch(parameter)
        if match is None:
            continue
        name = match[1]
        reason = (
            "the label is given twice"
            if name in labels
            else f"a name has 1 to {MAX_METADATA_NAME} characters"
            if not 1 <= len(name) <= MAX_METADATA_NAME
            else "a label cannot contain the character U+0000"
            if "\0" in name + value
            else f"a value has at most {MAX_METADATA_VALUE} characters"
            if len(value) > MAX_METADATA_VALUE
            else f"at most {MAX_METADATA_ENTRIES} labels are allowed"
            if len(labels) == MAX_METADATA_ENTRIES
            else ""
        )
        if reason:
            location = ["query", "metadata", name[:MAX_METADATA_NAME]]
            raise ParameterError.at(location, f"query.metadata: {reason}.", message=reason)
        labels[name] = value
    return labels
