"""Create jobs: post, validate, retry and branch them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Header, Query, Request, Response

from meshdeform.api.documents import FoundParts, Validation
from meshdeform.api.jobs import JobView
from meshdeform.api.limits import FETCH_SOON_S, MAX_DOCUMENT_BYTES, MAX_INLINE_BYTES
from meshdeform.errors import (
    ConflictError,
    DependencyError,
    NotFoundError,
    RequestError,
    StoredFileError,
    UnreadableJobError,
    WebhookAddressError,
)
from meshdeform.requests.choices import PartsAs
from meshdeform.requests.document import JobRequest
from meshdeform.runs import kinds
from service.documentation.responses import (
    ASSET_ERRORS,
    CALLER_ERRORS,
    ETAG,
    FILE,
    LOCATION,
    NEW_JOB_ERRORS,
    REPLAY,
    REQUEST_ERRORS,
    RETRY_AFTER,
    WAITED,
    JobId,
    Step,
    form_body,
    json_body,
)
from service.events.waiting import Prefer, applied, preferred_wait, settled
from service.http.auth import PrincipalDep
from service.http.bodies import body_of, parse_document, receive_document
from service.http.callers import while_waited_for
from service.http.errors import KNOWN_QUERY, answers, problem_responses
from service.http.forms import receive_form
from service.http.idempotency import Caller, IdempotencyKey, KeptAnswer
from service.jobs.arrivals import Arrivals, arriving, complete_later, with_inline_files
from service.jobs.continuation import branch, retry
from service.jobs.documents import BranchDocument, JobDocument, RetryDocument
from service.jobs.intake import Submission, accept_early, accept_job, file_advice, list_parts, missing_files, validate
from service.jobs.routes import shown
from service.state import AppState, AppStateDep
from service.webhooks.routes import checked_address

router = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=KNOWN_QUERY)

_DOCUMENT = {"prompt": "a mushroom", "params": {"seed": 7}}
_HEADERS = {**LOCATION, **RETRY_AFTER, **ETAG, **REPLAY}
FILES = {
    file.name: {
        **FILE,
        "description": f"{file.summary} If absent, `request.files.{file.name}` names a stored file.",
    }
    for kind in reversed(kinds())  # where kinds share a file, the first describes it
    for file in kind.reads
}
BODY = form_body(
    "JobDocument",
    FILES,
    {
        "prompt": {
            "summary": "An asset and a prompt",
            "value": {"asset": "the bytes of sphere.glb", "request": _DOCUMENT},
        },
        "target": {
            "summary": "An asset and a second mesh",
            "value": {
                "asset": "the bytes of sphere.glb",
                "request": {"params": {"seed": 7}},
                "target": "the bytes of vase.glb",
            },
        },
    },
    {
        "examples": {
            name: {"summary": summary, "value": {**_DOCUMENT, "asset": asset}}
            for name, summary, asset in (
                ("upload", "Use a complete upload", {"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}),
                (
                    "artifact",
                    "Use a result of another job",
                    {"job_id": "job_01kg9zqk2xf3v8c5m7n9p1r4t6", "artifact": "result.glb"},
                ),
                ("url", "Let the server fetch the asset", {"url": "https://example.org/models/sphere.glb"}),
                ("inline", "An asset in the document", {"data": "Z2xURgIAAAA...", "filename": "sphere.glb"}),
            )
        }
    },
)
# The Python generator writes code that cannot be imported for an operation with two media types and no parameter.
RequestId = Annotated[
    str | None,
    Header(
        description="Your id of this request, returned in the response and written to the server's log. "
        "Default: a new one.",
        max_length=128,
        pattern=r"^[\x21-\x7e]+$",
        examples=["req_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    ),
]


@router.post(
    "",
    summary="Create a job",
    status_code=202,
    responses={
        200: {
            "model": JobView,
            "description": "Accepted, and ended within the time in `Prefer`.",
            "headers": WAITED,
        },
        202: {"model": JobView, "description": "Accepted.", "headers": {**_HEADERS, **WAITED}},
        **problem_responses(
            StoredFileError, *ASSET_ERRORS, *REQUEST_ERRORS, *NEW_JOB_ERRORS, ConflictError, *CALLER_ERRORS
        ),
    },
    openapi_extra=BODY,
)
async def create_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    idempotency_key: IdempotencyKey = None,
    prefer: Prefer = None,  # noqa: ARG001 - declared for OpenAPI; read from the request, since the header may be repeated
) -> Response:
    """What was sent is checked completely first. An accepted job reaches exactly one terminal state.

    A file from a URL that is not there within 5 seconds is fetched and checked after the answer, while the job is
    `queued` in the phase `fetching`.
    """
    caller = Caller.of(request, principal, idempotency_key)
    answer = await _created(request, app, caller)
    wait_s = preferred_wait(request)
    if wait_s is None or answer.replayed:
        return answer.response()
    job = await settled(app.waiters, app.record, answer.body["id"], principal.owner_id, wait_s, request=request)
    headers = {"Location": answer.headers["Location"], **applied(wait_s)}
    return shown(job, status=200 if job.state.terminal else 202, headers=headers)


async def _created(request: Request, app: AppState, caller: Caller) -> KeptAnswer:
    """Accept a job once its files are there, or, if one comes from a slow host, before."""
    owner_id = caller.owner_id
    async with AsyncExitStack() as held:
        arrivals = await held.enter_async_context(receiving(request, app, owner_id))
        if await arrivals.within(FETCH_SOON_S):
            submission = await arrivals.all()
            if submission.urls:
                await held.enter_async_context(app.bodies.slot(owner_id))
            return await app.take_in(owner_id, accept_job, app, caller, submission)
        answer = await app.take_in(owner_id, accept_early, app, caller, arrivals.submission)
        if not answer.replayed:
            complete_later(app, caller, answer.body["id"], arrivals, held.pop_all())
        return answer


@router.post(
    ":validate",
    summary="Validate a job without creating it",
    responses=answers(
        Validation,
        "The job would be accepted.",
        StoredFileError,
        *ASSET_ERRORS,
        *REQUEST_ERRORS,
        ConflictError,
        *CALLER_ERRORS,
    ),
    openapi_extra=BODY,
)
async def validate_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    x_request_id: RequestId = None,  # noqa: ARG001 - read by the middleware
) -> Response:
    """Takes the bodies of `POST /v1/jobs`, reports the same problems, and estimates the run time. Stores nothing."""
    async with submitted(request, app, principal.owner_id) as submission:
        validation = await app.take_in(principal.owner_id, validate, app, principal, submission)
    return Response(validation.model_dump_json(), media_type="application/json")


@router.post(
    ":parts",
    summary="List the parts of the asset that words can name",
    responses=answers(
        FoundParts,
        "The parts, or those of the prompt and what it makes of the asset.",
        StoredFileError,
        *ASSET_ERRORS,
        *REQUEST_ERRORS,
        ConflictError,
        DependencyError,
        *CALLER_ERRORS,
    ),
    openapi_extra=BODY,
)
async def list_job_parts(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    glb: Annotated[
        PartsAs | None,
        Query(
            description="Give the asset back with its parts in this form, as `result`: the vertex attribute `_PART`, "
            "materials or child nodes. Default: without.",
            examples=["attribute"],
        ),
    ] = None,
    x_request_id: RequestId = None,  # noqa: ARG001 - read by the middleware
) -> Response:
    """Takes the bodies of `POST /v1/jobs`, which need no prompt, and stores nothing.

    With a prompt that is a change in plain words, only the parts that it names, and the asset as it would become. It
    takes a second, in a process of its own on the API's machine, which needs the extra `deform`.
    """
    app.previews.prepare()  # whoever asks for parts is about to type
    async with submitted(request, app, principal.owner_id) as submission, while_waited_for(request):
        parts = await list_parts(app, principal.owner_id, submission, glb)
    return Response(parts.model_dump_json(), media_type="application/json")


@router.post(
    "/{id}/retry",
    summary="Retry a job that did not succeed",
    status_code=202,
    responses=answers(
        JobView,
        "A new job.",
        NotFoundError,
        ConflictError,
        UnreadableJobError,
        StoredFileError,
        *REQUEST_ERRORS,
        *NEW_JOB_ERRORS,
        *CALLER_ERRORS,
        status=202,
        headers=_HEADERS,
    ),
    openapi_extra=json_body("RetryDocument", {"max_run_s": 7200}, required=False),
)
async def retry_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    id: JobId,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Creates a new job that continues a failed, canceled or expired one from its last checkpoint.

    The body, if any, says how long the new job may run.
    """
    caller = Caller.of(request, principal, idempotency_key)
    sent = request.headers.get("content-length", "0") != "0" or "transfer-encoding" in request.headers
    document = parse_document(RetryDocument, await receive_document(request)) if sent else None
    answer = await to_thread.run_sync(retry, app, caller, id, document)
    return answer.response()


@router.post(
    "/{id}/checkpoints/{step}/branch",
    summary="Branch a job from a checkpoint",
    status_code=202,
    responses=answers(
        JobView,
        "A new job.",
        NotFoundError,
        StoredFileError,
        *ASSET_ERRORS,
        *REQUEST_ERRORS,
        *NEW_JOB_ERRORS,
        ConflictError,
        UnreadableJobError,
        *CALLER_ERRORS,
        status=202,
        headers=_HEADERS,
    ),
    openapi_extra=json_body("BranchDocument", {"prompt": "a vase", "params": {"seed": 7}}),
)
async def branch_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    id: JobId,
    step: Step,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Creates a new job on the same files that starts with the shape of that step. The job may be in any state."""
    caller = Caller.of(request, principal, idempotency_key)
    document = parse_document(BranchDocument, await receive_document(request))
    await _check_webhook(app, principal.owner_id, document)
    with app.workspace.temporary_folder() as folder:
        answer = await app.take_in(principal.owner_id, branch, app, caller, id, step, document, folder)
    return answer.response()


async def _check_webhook(app: AppState, owner_id: str, request: JobRequest) -> None:
    """Refuse a request whose webhook has an address that is not allowed."""
    if request.webhook is None:
        return
    try:
        await checked_address(app, owner_id, request.webhook.url)
    except WebhookAddressError as error:
        location = {"loc": ["webhook", "url"], "msg": error.detail, "type": "value_error"}
        raise WebhookAddressError(error.detail, advice=error.advice_text, errors=[location]) from error


async def _received(
    request: Request, app: AppState, owner_id: str, held: AsyncExitStack, model: type[JobDocument], folder: Path
) -> Submission:
    """Receive a request; a form, and a long document, which may hold files, take a slot."""
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() == "application/json":
        length = request.headers.get("content-length", "")
        if length.isdigit() and int(length) <= MAX_DOCUMENT_BYTES:
            return Submission(_parsed(await receive_document(request), model), {}, folder)
        await held.enter_async_context(app.bodies.slot(owner_id))
        text = await receive_document(request, min(MAX_INLINE_BYTES, app.settings.max_upload_bytes))
        return Submission(await to_thread.run_sync(_parsed, text, model), {}, folder)
    # The slot is held until the files are checked and stored, which bounds the number of temporary files.
    await held.enter_async_context(app.bodies.slot(owner_id))
    text, files = await receive_form(
        request.headers.get("content-type", ""),
        request.headers.get("content-length", ""),
        body_of(request),
        folder,
        app.settings.max_upload_bytes,
    )
    document = parse_document(model, text, "The field `request`")
    for name in missing_files(document, files):
        raise RequestError(f"The field `{name}` is missing.", advice=file_advice(name))
    return Submission(document, files, folder)


def _parsed(text: bytes, model: type[JobDocument]) -> JobDocument:
    """Parse a document; what it has beside its files is no longer than any other document."""
    document = parse_document(model, text)
    inline = sum(len(source.data or "") for source, _ in document.sources.values())
    if len(text) - inline > MAX_DOCUMENT_BYTES:
        raise RequestError(f"The document is longer than {MAX_DOCUMENT_BYTES} bytes without its files.")
    return document


@asynccontextmanager
async def receiving(
    request: Request, app: AppState, owner_id: str, model: type[JobDocument] = JobDocument
) -> AsyncIterator[Arrivals]:
    """Receive a request and start to fetch what it names by URLs; all files are deleted when the block ends.

    No slot for bodies is held while the host of a URL is waited for.
    """
    async with AsyncExitStack() as kept:
        folder = kept.enter_context(app.workspace.temporary_folder())
        async with AsyncExitStack() as held:
            submission = await _received(request, app, owner_id, held, model, folder)
            await _check_webhook(app, owner_id, submission.document)
            submission = await with_inline_files(app, owner_id, submission)
            if not submission.document.sources:
                kept.push_async_exit(held.pop_all())
        yield await kept.enter_async_context(arriving(app, owner_id, submission))


@asynccontextmanager
async def submitted(
    request: Request, app: AppState, owner_id: str, model: type[JobDocument] = JobDocument
) -> AsyncIterator[Submission]:
    """Receive a request and all its files, which are deleted when the block ends."""
    async with receiving(request, app, owner_id, model) as arrivals, AsyncExitStack() as held:
        submission = await arrivals.all()
        if submission.urls:
            await held.enter_async_context(app.bodies.slot(owner_id))
        yield submission
