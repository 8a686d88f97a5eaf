"""Jobs are made: posted, tried out without being made, tried again, and branched off another one."""

from __future__ import annotations

import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path as FilePath
from typing import Annotated, Any

from anyio import to_thread
from fastapi import APIRouter, Header, Path, Request, Response

from meshdeform.api.jobs import JobView
from meshdeform.errors import ConflictError, NotFoundError, RequestError
from service.documentation.responses import (
    ASSET_ERRORS,
    CALLER_ERRORS,
    ETAG,
    LOCATION,
    NEW_JOB_ERRORS,
    REPLAY,
    REQUEST_ERRORS,
    RETRY_AFTER,
    WAITED,
    JobId,
    json_body,
)
from service.events.waiting import Prefer, applied, preferred_wait, settled
from service.http.auth import PrincipalDep
from service.http.bodies import body_of, body_slot, parse_document, receive_document
from service.http.errors import problem_responses
from service.http.idempotency import Caller, IdempotencyKey
from service.http.multipart import receive_form
from service.http.queries import KNOWN_QUERY
from service.jobs.continuation import branch, retry
from service.jobs.documents import BranchDocument, JobDocument
from service.jobs.intake import take_in, try_out
from service.jobs.routes import shown
from service.jobs.sources import Submission, file_advice, missing_files
from service.schemas import Validation
from service.state import AppState, AppStateDep

__all__ = ["router"]

router = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=KNOWN_QUERY)

_UPLOAD = {"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}
_DOCUMENT = {"prompt": "a mushroom", "params": {"preset": "preview", "seed": 7}}
_HEADERS = {**LOCATION, **RETRY_AFTER, **ETAG, **REPLAY}
# `format: binary` comes from OpenAPI 3.0; code generators still rely on it to recognise files.
_FILE = {"type": "string", "format": "binary", "contentMediaType": "application/octet-stream"}
_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["request"],
                    "additionalProperties": False,
                    "properties": {
                        "asset": {
                            **_FILE,
                            "description": "The file to deform: GLB, OBJ, PLY or STL. Without it `request.asset` "
                            "names one that the service has.",
                        },
                        "request": {"$ref": "#/components/schemas/JobDocument"},
                        "target": {
                            **_FILE,
                            "description": "A second mesh, where `params.guidance` is `target`; or `request.target`.",
                        },
                    },
                },
                "encoding": {
                    "asset": {"contentType": "application/octet-stream"},
                    "request": {"contentType": "application/json"},
                    "target": {"contentType": "application/octet-stream"},
                },
                "examples": {
                    "prompt": {
                        "summary": "An asset and a prompt",
                        "value": {"asset": "the bytes of sphere.glb", "request": _DOCUMENT},
                    },
                    "target": {
                        "summary": "An asset and a second mesh",
                        "value": {
                            "asset": "the bytes of sphere.glb",
                            "request": {"params": {"preset": "preview", "guidance": "target"}},
                            "target": "the bytes of vase.glb",
                        },
                    },
                },
            },
            "application/json": {
                "schema": {"$ref": "#/components/schemas/JobDocument"},
                "examples": {
                    "upload": {"summary": "A complete upload", "value": {**_DOCUMENT, "asset": _UPLOAD}},
                    "artifact": {
                        "summary": "A result of another job",
                        "value": {
                            **_DOCUMENT,
                            "asset": {"job_id": "job_01kg9zqk2xf3v8c5m7n9p1r4t6", "artifact": "result.glb"},
                        },
                    },
                },
            },
        },
    }
}
# The Python generator writes code that cannot be imported for an operation with two media types and no parameter.
_RequestId = Annotated[
    str | None,
    Header(
        description="Your id of this request, returned in the response and written to the server's log. "
        "Default: a new one.",
        max_length=128,
        pattern=r"^[\x21-\x7e]+$",
        examples=["req_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    ),
]
_Step = Annotated[int, Path(description="Step of the checkpoint.", ge=0, le=2**31 - 1, examples=[500])]


@router.post(
    "",
    operation_id="create_job",
    summary="Post an asset and say what it should become",
    status_code=202,
    responses={
        200: {"model": JobView, "description": "Accepted, and over within the time of `Prefer`.", "headers": WAITED},
        202: {"model": JobView, "description": "Accepted.", "headers": {**_HEADERS, **WAITED}},
        **problem_responses(*ASSET_ERRORS, *REQUEST_ERRORS, *NEW_JOB_ERRORS, ConflictError, *CALLER_ERRORS),
    },
    openapi_extra=_BODY,
)
async def create_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    idempotency_key: IdempotencyKey = None,
    prefer: Prefer = None,  # noqa: ARG001 - read from the request, where it may come more than once
) -> Response:
    """Everything is checked first: what is accepted can be run, and reaches exactly one terminal state."""
    caller = Caller.of(request, principal, idempotency_key)
    async with _submitted(request, app) as sent:
        answer = await to_thread.run_sync(take_in, app, caller, sent, limiter=app.intake)
    wait_s = preferred_wait(request)
    if wait_s is None or answer.replayed:
        return answer.response()
    job = await settled(app, answer.body["id"], principal.owner_id, wait_s, request=request)
    headers = {"Location": answer.headers["Location"], **applied(wait_s)}
    return shown(job, status=200 if job.state.terminal else 202, headers=headers)


@router.post(
    ":validate",
    operation_id="validate_job",
    summary="Check a job without posting it",
    responses={
        200: {"model": Validation, "description": "It would be accepted."},
        **problem_responses(*ASSET_ERRORS, *REQUEST_ERRORS, ConflictError, *CALLER_ERRORS),
    },
    openapi_extra=_BODY,
)
async def validate_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    x_request_id: _RequestId = None,  # noqa: ARG001 - read by the middleware
) -> Response:
    """The bodies of `POST /v1/jobs` and the same problems; nothing is stored. Says how long the job would take."""
    async with _submitted(request, app) as sent:
        found = await to_thread.run_sync(try_out, app, principal.owner_id, sent, limiter=app.intake)
    return Response(found.model_dump_json(), media_type="application/json")


@router.post(
    "/{id}/retry",
    operation_id="retry_job",
    summary="Try a job again that did not succeed",
    status_code=202,
    responses={
        202: {"model": JobView, "description": "A new job.", "headers": _HEADERS},
        **problem_responses(NotFoundError, ConflictError, *REQUEST_ERRORS, *NEW_JOB_ERRORS, *CALLER_ERRORS),
    },
)
def retry_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    id: JobId,  # noqa: A002 - the path's own word
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """A job that failed, was canceled or has expired, as a new job that goes on from its last checkpoint."""
    return retry(app, Caller.of(request, principal, idempotency_key), id).response()


@router.post(
    "/{id}/checkpoints/{step}/branch",
    operation_id="branch_job",
    summary="Go another way from a checkpoint",
    status_code=202,
    responses={
        202: {"model": JobView, "description": "A new job.", "headers": _HEADERS},
        **problem_responses(
            NotFoundError, *ASSET_ERRORS, *REQUEST_ERRORS, *NEW_JOB_ERRORS, ConflictError, *CALLER_ERRORS
        ),
    },
    openapi_extra=json_body("BranchDocument", {"prompt": "a vase", "params": {"preset": "preview"}}),
)
async def branch_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    id: JobId,  # noqa: A002
    step: _Step,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """A new job on the same asset that begins with the shape of that step. The other job may be in any state."""
    caller = Caller.of(request, principal, idempotency_key)
    document = parse_document(BranchDocument, await receive_document(request))
    with tempfile.TemporaryDirectory(prefix="meshdeform-branch-") as folder:
        answer = await to_thread.run_sync(branch, app, caller, id, step, document, FilePath(folder), limiter=app.intake)
    return answer.response()


@asynccontextmanager
async def _submitted(request: Request, app: AppState) -> AsyncIterator[Submission]:
    """Receive what a request asks for; its files lie in a folder that goes when the block ends."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind == "application/json":
        document = parse_document(JobDocument, await receive_document(request))
        with tempfile.TemporaryDirectory(prefix="meshdeform-upload-") as folder:
            yield Submission(document, {}, FilePath(folder))
        return
    # The place is kept until the files are checked and stored: so many may lie here, not more.
    async with body_slot(app.bodies):
        with tempfile.TemporaryDirectory(prefix="meshdeform-upload-") as folder:
            text, files = await receive_form(
                request.headers.get("content-type", ""),
                request.headers.get("content-length", ""),
                body_of(request),
                FilePath(folder),
                app.settings.max_upload_bytes,
            )
            document = parse_document(JobDocument, text, "The part `request`")
            for name in missing_files(document, files):
                raise RequestError(f"The part `{name}` is missing.", advice=file_advice(name))
            yield Submission(document, files, FilePath(folder))
