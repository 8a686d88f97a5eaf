"""Jobs: post, look, list, cancel, delete."""

from __future__ import annotations

import contextlib
import logging
import tempfile
from pathlib import Path as FilePath
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Header, Path, Query, Request, Response
from fastapi.responses import JSONResponse

from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetExternalError,
    AssetFormatError,
    AssetNotFiniteError,
    AssetTooLargeError,
    AssetTruncatedError,
    AssetUnsupportedError,
    ConflictError,
    ModelError,
    NotFoundError,
    ParameterError,
    PromptError,
    RequestError,
    UnavailableError,
    VocabularyError,
)
from meshdeform.jobs.cleanup import remove_unreachable
from meshdeform.jobs.ids import JOB_ID_PATTERN
from meshdeform.jobs.models import Job, JobState
from meshdeform.jobs.views import JobList, JobView
from service.deps import PartsDep
from service.errors import problem_responses
from service.intake import take_in
from service.multipart import receive_form
from service.ranges import matches

__all__ = ["JobId", "router"]

_log = logging.getLogger(__name__)
_POLL_S = "1"
router = APIRouter(prefix="/v1/jobs", tags=["jobs"])

JobId = Annotated[
    str,
    Path(
        description="The job's id, as `POST /v1/jobs` gave it.",
        pattern=JOB_ID_PATTERN,
        examples=["job_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    ),
]

_ASSET_ERRORS = (
    AssetTooLargeError,
    AssetFormatError,
    AssetError,
    AssetTruncatedError,
    AssetExternalError,
    AssetUnsupportedError,
    AssetNotFiniteError,
    AssetEmptyError,
)
_REQUEST_ERRORS = (RequestError, ParameterError, PromptError, VocabularyError, ModelError)
_ETAG = {"ETag": {"description": "Changes with the job.", "schema": {"type": "string"}, "example": 'W/"7"'}}
_RETRY = {
    "Retry-After": {"description": "When to look again, in seconds.", "schema": {"type": "integer"}, "example": 1}
}
_LOCATION = {
    "Location": {
        "description": "The job's URL.",
        "schema": {"type": "string"},
        "example": "/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6",
    }
}
_FORM = {
    "required": True,
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["asset", "request"],
                "additionalProperties": False,
                "properties": {
                    "asset": {
                        "type": "string",
                        "contentMediaType": "application/octet-stream",
                        "description": "The file to deform: GLB, OBJ, PLY or STL.",
                    },
                    "request": {"$ref": "#/components/schemas/JobRequest"},
                    "target": {
                        "type": "string",
                        "contentMediaType": "application/octet-stream",
                        "description": "A second mesh, where `params.guidance` is `target`.",
                    },
                },
            },
            "encoding": {"request": {"contentType": "application/json"}},
        }
    },
}


@router.post(
    "",
    operation_id="create_job",
    summary="Post an asset and say what it shall become",
    status_code=202,
    responses={
        202: {"model": JobView, "description": "Accepted.", "headers": {**_LOCATION, **_RETRY, **_ETAG}},
        **problem_responses(*_ASSET_ERRORS, *_REQUEST_ERRORS, UnavailableError),
    },
    openapi_extra={"requestBody": _FORM},
)
async def create_job(request: Request, parts: PartsDep) -> Response:
    """Everything is checked first: what is accepted can be run, and reaches exactly one terminal state."""
    with tempfile.TemporaryDirectory(prefix="meshdeform-upload-") as folder:
        form = await receive_form(
            request.headers.get("content-type", ""),
            request.headers.get("content-length", ""),
            request.stream(),
            FilePath(folder),
            parts.settings.max_upload_bytes,
        )
        job = await to_thread.run_sync(take_in, parts, form, limiter=parts.intake)
    return _answer(job, status=202, headers={"Location": f"/v1/jobs/{job.id}"})


@router.get(
    "",
    operation_id="list_jobs",
    summary="List jobs, newest first",
    responses={
        200: {"model": JobList, "description": "A page of jobs."},
        **problem_responses(ParameterError, UnavailableError),
    },
)
def list_jobs(
    parts: PartsDep,
    state: Annotated[
        JobState | None, Query(description="Only jobs in this state. Default: all.", examples=["running"])
    ] = None,
    limit: Annotated[int, Query(description="Length of a page.", ge=1, le=200, examples=[50])] = 50,
    cursor: Annotated[
        str | None,
        Query(
            description="`next_cursor` of the page before. Default: the first page.",
            max_length=200,
            examples=["am9iXzAxa2c5enFrMnhmM3Y4YzVtN245cDFyNHQ2"],
        ),
    ] = None,
) -> Response:
    """Jobs that come in between two pages do not shift the second one."""
    page = parts.record.list_jobs(state, cursor, limit)
    return JSONResponse(JobList(jobs=[JobView.of(job) for job in page.jobs], next_cursor=page.next_cursor).as_json())


@router.get(
    "/{id}",
    operation_id="get_job",
    summary="Look at a job",
    responses={
        200: {"model": JobView, "description": "The job.", "headers": {**_ETAG, **_RETRY}},
        304: {"description": "Not changed since the version that `If-None-Match` names.", "headers": _ETAG},
        **problem_responses(NotFoundError, UnavailableError),
    },
)
def get_job(
    parts: PartsDep,
    id: JobId,  # noqa: A002 - the path's own word
    if_none_match: Annotated[
        str | None,
        Header(
            description="The `ETag` of the version that you have. Default: none.", max_length=1000, examples=['W/"7"']
        ),
    ] = None,
) -> Response:
    """With `If-None-Match` a job that has not changed costs a 304 without a body."""
    job = parts.record.get(id)
    if matches(if_none_match, _tag(job)):
        return Response(status_code=304, headers=_headers(job))
    return _answer(job)


@router.post(
    "/{id}/cancel",
    operation_id="cancel_job",
    summary="Cancel a job",
    responses={
        200: {"model": JobView, "description": "`canceled`, or `canceling` until its worker stops.", "headers": _ETAG},
        **problem_responses(NotFoundError, ConflictError, UnavailableError),
    },
)
def cancel_job(parts: PartsDep, id: JobId) -> Response:  # noqa: A002
    """A queued job is canceled at once, a running one within a step. A job that is over gives 409."""
    job = parts.record.request_cancel(id)
    if job.state is JobState.CANCELING:
        try:
            parts.queue.publish_cancel(id)
        except UnavailableError as error:
            # Its worker reads the record with every heartbeat: it stops a little later.
            _log.warning("job %s: its worker is not told at once: %s", id, error)
    return _answer(job)


@router.delete(
    "/{id}",
    operation_id="delete_job",
    summary="Delete a job with its artifacts",
    status_code=204,
    response_class=Response,
    responses={
        204: {"description": "It is gone."},
        **problem_responses(NotFoundError, ConflictError, UnavailableError),
    },
)
def delete_job(parts: PartsDep, id: JobId) -> Response:  # noqa: A002
    """Only a job that is over: cancel it first. The asset goes too, unless another job uses it."""
    parts.record.delete(id)
    with contextlib.suppress(UnavailableError):
        # The record knows what is left to remove: if the store is away now, the reconciler does it later.
        remove_unreachable(parts.record, parts.store)
    return Response(status_code=204)


def _tag(job: Job) -> str:
    return f'W/"{job.version}"'


def _headers(job: Job) -> dict[str, str]:
    retry = {} if job.state.terminal else {"Retry-After": _POLL_S}
    return {"ETag": _tag(job), "Cache-Control": "no-cache", **retry}


def _answer(job: Job, *, status: int = 200, headers: dict[str, str] | None = None) -> JSONResponse:
    return JSONResponse(JobView.of(job).as_json(), status, {**_headers(job), **(headers or {})})
