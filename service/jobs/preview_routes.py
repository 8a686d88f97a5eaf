"""Show what a job would make before it is sent."""

from __future__ import annotations

from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Query, Request, Response

from meshdeform.api.limits import MAX_PREVIEWED, PREVIEW_S
from meshdeform.errors import AssetNotKeptError, ConflictError, DependencyError, NumericalError, StoredFileError
from service.documentation.responses import ASSET_ERRORS, BYTES, CALLER_ERRORS, REQUEST_ERRORS, form_body, header
from service.http.auth import PrincipalDep
from service.http.errors import KNOWN_QUERY, problem_responses
from service.jobs.creation_routes import FILES, RequestId, submitted
from service.jobs.documents import PreviewDocument
from service.jobs.previews import As, preview
from service.state import AppStateDep

router = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=KNOWN_QUERY)

_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
_DOCUMENT = {"prompt": "a mushroom", "seeds": [0, 1, 2, 3, 4, 5]}
_BODY = form_body(
    "PreviewDocument",
    FILES,
    {
        "first": {
            "summary": "The first preview of an asset",
            "value": {"asset": "the bytes of sphere.glb", "request": _DOCUMENT},
        }
    },
    {"examples": {"next": {"summary": "The next prompt", "value": {**_DOCUMENT, "asset": {"sha256": _SHA256}}}}},
)


@router.post(
    ":preview",
    summary="Show what a job would make",
    response_class=Response,
    responses={
        200: {
            "description": "The shapes, as `as` says.",
            "headers": {
                "Meshdeform-Asset": header(
                    "SHA-256 of the asset, by which the next preview can name it: `asset.sha256`.", _SHA256
                ),
                "Meshdeform-Draft": header("`true`: a draft; ask again without `draft` for the shape itself.", "false"),
            },
            "content": BYTES,
        },
        **problem_responses(
            StoredFileError,
            NumericalError,
            *ASSET_ERRORS,
            *REQUEST_ERRORS,
            AssetNotKeptError,
            ConflictError,
            DependencyError,
            *CALLER_ERRORS,
        ),
    },
    openapi_extra=_BODY,
    description=f"Takes the bodies of `POST /v1/jobs`, with up to {MAX_PREVIEWED} `seeds`, and the same problems "
    "answer them. Nothing is stored: a job with the same request and seed makes the same bytes. Only what `exemplar` "
    f"guidance and changes in plain words make, within {PREVIEW_S:g} s, in a process of its own on the API's machine, "
    "which needs the extra `deform`. It ends when the client goes.",
)
async def preview_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    form: Annotated[
        As,
        Query(
            alias="as",
            description="`positions`: of the vertices of `result.glb`, quantised, for all seeds "
            "(docs/http.md#post-v1jobspreview); `glb`: the `result.glb` of one seed.",
            examples=["positions"],
        ),
    ] = "positions",
    draft: Annotated[
        bool,
        Query(
            description="Whether a draft of a fit will do, unmended; of a large asset, a simplified surface is fitted, "
            "which the asset follows. The vertices are the same. `Meshdeform-Draft` says whether it is one.",
            examples=[True],
        ),
    ] = False,
    x_request_id: RequestId = None,  # noqa: ARG001 - read by the middleware
) -> Response:
    """Make a preview."""
    async with submitted(request, app, principal.owner_id, PreviewDocument) as submission:
        made = await preview(app, request, principal.owner_id, submission, form, draft=draft)
        data = await to_thread.run_sync(made.path.read_bytes)
    # As described: code generators know no other media type for bytes.
    headers = {"Meshdeform-Asset": made.asset, "Meshdeform-Draft": str(made.draft).lower()}
    return Response(data, media_type="application/octet-stream", headers=headers)
