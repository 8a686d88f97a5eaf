"""Uploads: files that are sent by themselves, in pieces if need be, and named by jobs afterwards."""

from __future__ import annotations

from typing import Annotated

import sqlalchemy as sa
from anyio import to_thread
from fastapi import APIRouter, Header, Path, Request, Response

from meshdeform.errors import (
    AssetTooLargeError,
    ChecksumError,
    ConflictError,
    ForbiddenError,
    NotFoundError,
    ParameterError,
    RequestError,
    RequestTimeoutError,
    UnavailableError,
)
from meshdeform.record.cleanup import remove_upload
from meshdeform.record.uploads import Upload
from service.documentation.responses import CALLER_ERRORS, ONCE_ERRORS, REPLAY, json_body
from service.http.auth import PrincipalDep
from service.http.bodies import body_of, body_slot, parse_document, receive_document
from service.http.errors import problem_responses
from service.http.idempotency import Answer, Caller, IdempotencyKey, claimed, request_hash
from service.http.multipart import clean_filename
from service.http.queries import KNOWN_QUERY
from service.jobs.documents import UPLOAD_ID_PATTERN, UploadCompletion, UploadDocument
from service.schemas import UploadView
from service.state import AppState, AppStateDep
from service.uploads.receiving import admitted, arrived, complete, parse_content_range, receive_content, view

__all__ = ["content", "router"]

router = APIRouter(prefix="/v1/uploads", tags=["uploads"], dependencies=KNOWN_QUERY)
content = APIRouter(prefix="/v1/uploads", tags=["uploads"])
"""The routes of signed URLs, which need no API key."""

_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
_UploadId = Annotated[
    str,
    Path(
        description="The upload's id, as `POST /v1/uploads` gave it.",
        pattern=UPLOAD_ID_PATTERN,
        examples=["upl_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    ),
]
_Signed = {
    name: {
        "name": name,
        "in": "query",
        "required": True,
        "description": text,
        "schema": {"type": "string", "maxLength": 100},
        "example": example,
    }
    for name, text, example in (
        ("expires", "Until when the URL is valid, in Unix seconds.", "1769950800"),
        ("signature", "What makes it valid.", "3b1f09c2"),
    )
}
_OFFSET = {
    "Upload-Offset": {
        "description": "Bytes that have come altogether.",
        "schema": {"type": "integer"},
        "example": 1048576,
    }
}


@router.post(
    "",
    operation_id="create_upload",
    summary="Begin an upload",
    status_code=201,
    responses={
        201: {
            "model": UploadView,
            "description": "Where to send the bytes.",
            "headers": {
                "Location": {
                    "description": "The upload's URL.",
                    "schema": {"type": "string"},
                    "example": "/v1/uploads/upl_01kg9zqk2xf3v8c5m7n9p1r4t6",
                },
                **REPLAY,
            },
        },
        **problem_responses(
            AssetTooLargeError, RequestError, ParameterError, RequestTimeoutError, *ONCE_ERRORS, *CALLER_ERRORS
        ),
    },
    openapi_extra=json_body("UploadDocument", {"filename": "knight.glb", "size": 30720, "sha256": _SHA256}),
)
async def create_upload(
    request: Request, app: AppStateDep, principal: PrincipalDep, idempotency_key: IdempotencyKey = None
) -> Response:
    """Send the bytes to `url`, say that it is complete, and name it in `asset` or `target` of a job."""
    document = parse_document(UploadDocument, await receive_document(request))
    caller = Caller.of(request, principal, idempotency_key)
    answer = await to_thread.run_sync(_create, app, caller, document)
    return answer.response()


@router.get(
    "/{id}",
    operation_id="get_upload",
    summary="Look at an upload",
    responses={
        200: {"model": UploadView, "description": "The upload, with a new URL while it is open."},
        **problem_responses(NotFoundError, *CALLER_ERRORS),
    },
)
def get_upload(app: AppStateDep, principal: PrincipalDep, id: _UploadId) -> Response:  # noqa: A002 - the path's own word
    """`offset` says how much has come."""
    return _shown(view(app, app.record.uploads.get(id, principal.owner_id)))


@router.delete(
    "/{id}",
    operation_id="delete_upload",
    summary="Delete an upload",
    status_code=204,
    response_class=Response,
    responses={204: {"description": "It is gone."}, **problem_responses(NotFoundError, *CALLER_ERRORS)},
)
def delete_upload(app: AppStateDep, principal: PrincipalDep, id: _UploadId) -> Response:  # noqa: A002
    """Jobs that were made of it keep their file."""
    # The bytes first: if the store is away, the row remembers that they are there.
    remove_upload(app.store, app.record.uploads.get(id, principal.owner_id).id)
    app.record.uploads.delete(id, principal.owner_id)
    return Response(status_code=204)


@router.post(
    "/{id}/complete",
    operation_id="complete_upload",
    summary="Say that all bytes are sent",
    responses={
        200: {"model": UploadView, "description": "Complete: jobs may name it."},
        **problem_responses(
            NotFoundError,
            ConflictError,
            ChecksumError,
            RequestError,
            ParameterError,
            RequestTimeoutError,
            *CALLER_ERRORS,
        ),
    },
    openapi_extra=json_body("UploadCompletion", {"sha256": _SHA256}),
)
async def complete_upload(request: Request, app: AppStateDep, principal: PrincipalDep, id: _UploadId) -> Response:  # noqa: A002
    """Size and SHA-256 are compared with what came; where they differ the upload stays open. May be repeated."""
    document = parse_document(UploadCompletion, await receive_document(request))

    def work() -> UploadView:
        upload = app.record.uploads.get(id, principal.owner_id)
        return view(app, complete(app, upload, document.sha256))

    return _shown(await to_thread.run_sync(work, limiter=app.intake))


@content.put(
    "/{id}/content",
    operation_id="send_upload",
    summary="Send bytes of an upload",
    status_code=204,
    response_class=Response,
    responses={
        204: {"description": "They are stored.", "headers": _OFFSET},
        **problem_responses(
            ForbiddenError,
            NotFoundError,
            ConflictError,
            AssetTooLargeError,
            RequestError,
            RequestTimeoutError,
            UnavailableError,
        ),
    },
    openapi_extra={
        "security": [],
        "parameters": list(_Signed.values()),
        "requestBody": {
            "required": True,
            "content": {
                "application/octet-stream": {
                    "schema": {"type": "string", "contentMediaType": "application/octet-stream"}
                }
            },
        },
    },
)
async def send_upload(
    request: Request,
    app: AppStateDep,
    id: _UploadId,  # noqa: A002
    content_range: Annotated[
        str | None,
        Header(
            description="Which bytes these are: `bytes FIRST-LAST/SIZE`, beginning at the offset. Default: all, "
            "in place of what has come before.",
            max_length=100,
            examples=["bytes 1048576-2097151/30720000"],
        ),
    ] = None,
) -> Response:
    """The URL is signed: no API key. Where a body breaks off, what came stays; `HEAD` says how much that is."""
    upload = await to_thread.run_sync(_admitted, app, request, id)
    part = parse_content_range(content_range, upload)
    declared = request.headers.get("content-length", "")
    if declared.isdigit() and int(declared) > part.end - part.start:
        raise AssetTooLargeError(
            f"The body is longer than {part.end - part.start} bytes.",
            advice="Send the bytes that Content-Range or the upload's size announces.",
            limit=part.end - part.start,
        )
    async with body_slot(app.bodies):
        offset = await receive_content(app, upload, part, body_of(request))
    return Response(status_code=204, headers={"Upload-Offset": str(offset)})


@content.head("/{id}/content", include_in_schema=False)
def look_at_content(request: Request, app: AppStateDep, id: _UploadId) -> Response:  # noqa: A002
    """How much has come, for whoever holds the signed URL."""
    upload = _admitted(app, request, id)
    offset = upload.size if upload.complete else arrived(app, upload)
    headers = {"Upload-Offset": str(offset), "Upload-Length": str(upload.size), "Cache-Control": "no-store"}
    return Response(status_code=200, headers=headers)


def _create(app: AppState, caller: Caller, document: UploadDocument) -> Answer:
    limit = app.settings.max_upload_bytes
    if document.size > limit:
        raise AssetTooLargeError(
            f"The file has {document.size} bytes; the limit is {limit}.",
            advice="Simplify the mesh, or raise MESHDEFORM_MAX_UPLOAD_BYTES.",
            limit=limit,
        )

    # Made before the transaction begins: within it nothing else may write.
    app.record.secret("signed-urls")
    answers: list[Answer] = []
    asked = document.model_dump(mode="json", exclude_unset=True)
    with claimed(app.record, caller, request_hash(caller.method, caller.path, asked, {})) as claim:
        if isinstance(claim, Answer):
            return claim

        def also(connection: sa.Connection, upload: Upload) -> None:
            shown = view(app, upload, offset=0).model_dump(mode="json")
            headers = {"Location": f"/v1/uploads/{upload.id}", "Cache-Control": "no-store"}
            answers.append(Answer(201, shown, headers))
            if claim is not None:
                app.record.idempotency.complete(claim, answers[0].kept(), connection)

        filename = clean_filename(document.filename)
        app.record.uploads.create(
            caller.owner_id,
            filename,
            document.size,
            app.settings.upload_ttl_s,
            sha256=document.sha256,
            also=also,
        )
        return answers[0]


def _admitted(app: AppState, request: Request, upload_id: str) -> Upload:
    return admitted(app, upload_id, request.url.path, request.scope["query_string"].decode("latin-1"))


def _shown(found: UploadView) -> Response:
    # The URL in it is a permission.
    return Response(found.model_dump_json(), media_type="application/json", headers={"Cache-Control": "no-store"})
