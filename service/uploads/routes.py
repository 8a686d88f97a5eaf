"""Upload files, in pieces if need be, for use in later jobs."""

from __future__ import annotations

from typing import Annotated

import sqlalchemy as sa
from anyio import to_thread
from fastapi import APIRouter, Header, Path, Request, Response

from meshdeform.api.documents import UploadView
from meshdeform.assets.limits import Limits
from meshdeform.errors import (
    AssetTooLargeError,
    ChecksumError,
    ConflictError,
    ForbiddenError,
    NotFoundError,
    ParameterError,
    RequestError,
    RequestTimeoutError,
    TooManyUploadsError,
    UnavailableError,
)
from meshdeform.record.reconciler import remove_upload
from meshdeform.record.uploads import Upload
from service.documentation.responses import CALLER_ERRORS, ONCE_ERRORS, REPLAY, header, json_body
from service.http.auth import PrincipalDep
from service.http.bodies import body_of, parse_document, receive_document
from service.http.errors import KNOWN_QUERY, answers
from service.http.forms import clean_filename
from service.http.idempotency import Caller, IdempotencyKey, KeptAnswer, claimed, request_hash
from service.http.links import SIGNING_KEY
from service.jobs.documents import UPLOAD_ID_PATTERN, UploadCompletion, UploadDocument
from service.state import AppState, AppStateDep
from service.uploads.receiving import authorize, complete, parse_content_range, receive_content, received_bytes, view

router = APIRouter(prefix="/v1/uploads", tags=["uploads"], dependencies=KNOWN_QUERY)
content = APIRouter(prefix="/v1/uploads", tags=["uploads"])
"""The routes of signed URLs, which need no API key."""

_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
_UploadId = Annotated[
    str,
    Path(
        description="The upload's id, from `POST /v1/uploads`.",
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
        ("expires", "The URL's expiry time, in Unix seconds.", "1769950800"),
        ("signature", "The URL's signature.", "3b1f09c2"),
    )
}
_OFFSET = {"Upload-Offset": header("Received bytes, in total.", 1048576)}


@router.post(
    "",
    summary="Create an upload",
    status_code=201,
    responses=answers(
        UploadView,
        "Where to send the bytes.",
        AssetTooLargeError,
        RequestError,
        ParameterError,
        RequestTimeoutError,
        TooManyUploadsError,
        *ONCE_ERRORS,
        *CALLER_ERRORS,
        status=201,
        headers={
            "Location": header("The upload's URL.", "/v1/uploads/upl_01kg9zqk2xf3v8c5m7n9p1r4t6"),
            **REPLAY,
        },
    ),
    openapi_extra=json_body("UploadDocument", {"filename": "knight.glb", "size": 30720, "sha256": _SHA256}),
)
async def create_upload(
    request: Request, app: AppStateDep, principal: PrincipalDep, idempotency_key: IdempotencyKey = None
) -> Response:
    """Send the bytes to `url`, complete the upload, and name it in `files`, `asset` or `target` of a job."""
    document = parse_document(UploadDocument, await receive_document(request))
    caller = Caller.of(request, principal, idempotency_key)
    answer = await to_thread.run_sync(_create, app, caller, document)
    return answer.response()


@router.get(
    "/{id}",
    summary="Get an upload",
    responses=answers(UploadView, "The upload, with a new URL while it is open.", NotFoundError, *CALLER_ERRORS),
)
def get_upload(app: AppStateDep, principal: PrincipalDep, id: _UploadId) -> Response:
    """`offset` is the number of received bytes."""
    return _shown(view(app, app.record.uploads.get(id, principal.owner_id)))


@router.delete(
    "/{id}",
    summary="Delete an upload",
    status_code=204,
    response_class=Response,
    responses=answers(None, "The upload is deleted.", NotFoundError, *CALLER_ERRORS, status=204),
)
def delete_upload(app: AppStateDep, principal: PrincipalDep, id: _UploadId) -> Response:
    """Jobs that use the file keep it."""
    # The bytes first: if the store does not answer, the row still refers to them.
    remove_upload(app.store, app.record.uploads.get(id, principal.owner_id).id)
    app.record.uploads.delete(id, principal.owner_id)
    return Response(status_code=204)


@router.post(
    "/{id}/complete",
    summary="Complete an upload",
    responses=answers(
        UploadView,
        "The upload is complete, and jobs may name it.",
        NotFoundError,
        ConflictError,
        ChecksumError,
        RequestError,
        ParameterError,
        RequestTimeoutError,
        *CALLER_ERRORS,
    ),
    openapi_extra=json_body("UploadCompletion", {"sha256": _SHA256}),
)
async def complete_upload(request: Request, app: AppStateDep, principal: PrincipalDep, id: _UploadId) -> Response:
    """Compares size and SHA-256 with the received bytes; if they differ, the upload stays open. May be repeated."""
    document = parse_document(UploadCompletion, await receive_document(request))

    def work() -> UploadView:
        upload = app.record.uploads.get(id, principal.owner_id)
        return view(app, complete(app, upload, document.sha256))

    return _shown(await app.take_in(principal.owner_id, work))


@content.put(
    "/{id}/content",
    summary="Send bytes of an upload",
    status_code=204,
    response_class=Response,
    responses=answers(
        None,
        "The bytes are stored.",
        ForbiddenError,
        NotFoundError,
        ConflictError,
        AssetTooLargeError,
        RequestError,
        RequestTimeoutError,
        UnavailableError,
        status=204,
        headers=_OFFSET,
    ),
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
    id: _UploadId,
    content_range: Annotated[
        str | None,
        Header(
            description="The range of the body, beginning at the offset: `bytes FIRST-LAST/SIZE`. Default: the whole "
            "file, replacing bytes received before.",
            max_length=100,
            examples=["bytes 1048576-2097151/30720000"],
        ),
    ] = None,
) -> Response:
    """The URL is signed and needs no API key. Bytes of an interrupted body are kept; `HEAD` returns their number."""
    upload = await to_thread.run_sync(_authorized, app, request, id)
    piece = parse_content_range(content_range, upload)
    declared = request.headers.get("content-length", "")
    if declared.isdigit() and int(declared) > piece.end - piece.start:
        raise piece.exceeded()
    async with app.bodies.slot(upload.owner_id):
        offset = await receive_content(app, upload, piece, body_of(request))
    return Response(status_code=204, headers={"Upload-Offset": str(offset)})


@content.head("/{id}/content", include_in_schema=False)
def head_content(request: Request, app: AppStateDep, id: _UploadId) -> Response:
    """Return the number of received bytes to the bearer of a signed URL."""
    upload = _authorized(app, request, id)
    offset = upload.size if upload.complete else received_bytes(app, upload)
    headers = {"Upload-Offset": str(offset), "Upload-Length": str(upload.size), "Cache-Control": "no-store"}
    return Response(status_code=200, headers=headers)


def _create(app: AppState, caller: Caller, document: UploadDocument) -> KeptAnswer:
    Limits.from_settings(app.settings).check_bytes(document.size)

    # Created before the transaction begins, since SQLite allows only one writer.
    app.record.secret(SIGNING_KEY)
    answers: list[KeptAnswer] = []
    body = document.model_dump(mode="json", exclude_unset=True)
    with claimed(app.record, caller, request_hash(caller.method, caller.path, body, {})) as claim:
        if isinstance(claim, KeptAnswer):
            return claim

        def record_answer(connection: sa.Connection, upload: Upload) -> None:
            shown = view(app, upload, offset=0).model_dump(mode="json")
            headers = {"Location": f"/v1/uploads/{upload.id}", "Cache-Control": "no-store"}
            answers.append(KeptAnswer(201, shown, headers))
            if claim is not None:
                app.record.idempotency.complete(claim, answers[0].kept(), connection)

        filename = clean_filename(document.filename)
        app.record.uploads.create(
            caller.owner_id,
            filename,
            document.size,
            app.settings.upload_ttl_s,
            sha256=document.sha256,
            max_uploads=app.settings.max_uploads,
            max_bytes=app.settings.max_uploads_bytes,
            also=record_answer,
        )
        return answers[0]


def _authorized(app: AppState, request: Request, upload_id: str) -> Upload:
    # Not `request.url`, which older versions of Starlette build from the Host header.
    return authorize(app, upload_id, request.scope["path"], request.scope["query_string"].decode("latin-1"))


def _shown(view: UploadView) -> Response:
    # The body contains a signed URL.
    return Response(view.model_dump_json(), media_type="application/json", headers={"Cache-Control": "no-store"})
