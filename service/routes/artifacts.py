"""Artifacts of a job: list them, and stream their bytes, whole or in part."""

from __future__ import annotations

import base64
from typing import Annotated

from fastapi import APIRouter, Header, Path, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from meshdeform.errors import NotFoundError, RangeError, UnavailableError
from meshdeform.jobs.models import Artifact
from meshdeform.jobs.views import ArtifactList, ArtifactView
from service.deps import PartsDep
from service.errors import problem_responses
from service.ranges import matches, requested_range
from service.routes.jobs import JobId

__all__ = ["router"]

_CHUNK = 256 * 1024
router = APIRouter(prefix="/v1/jobs/{id}/artifacts", tags=["artifacts"])

_Name = Annotated[
    str,
    Path(
        description="The artifact's name.", min_length=1, max_length=128, pattern=r"^[\w.-]+$", examples=["result.glb"]
    ),
]
_BYTES = {"application/octet-stream": {"schema": {"type": "string", "contentMediaType": "application/octet-stream"}}}
_HEADERS = {
    name: {"description": description, "schema": {"type": "string"}, "example": example}
    for name, description, example in (
        ("ETag", "SHA-256 of the whole artifact.", '"9f86d081884c7d65..."'),
        ("Accept-Ranges", "Parts can be asked for.", "bytes"),
        ("Content-Disposition", "The name to save it under.", 'attachment; filename="result.glb"'),
    )
}
_CONTENT_RANGE = {
    "Content-Range": {
        "description": "Which bytes of how many.",
        "schema": {"type": "string"},
        "example": "bytes 0-1023/30720",
    }
}


@router.get(
    "",
    operation_id="list_artifacts",
    summary="List a job's artifacts",
    responses={
        200: {"model": ArtifactList, "description": "What the job's present attempt has stored."},
        **problem_responses(NotFoundError, UnavailableError),
    },
)
def list_artifacts(parts: PartsDep, id: JobId) -> Response:  # noqa: A002 - the path's own word
    """Artifacts are complete when the job is `succeeded`."""
    found = [ArtifactView.of(artifact, id) for artifact in parts.record.artifacts(id)]
    return JSONResponse(ArtifactList(artifacts=found).model_dump(mode="json"))


@router.head("/{name}", include_in_schema=False)
@router.get(
    "/{name}",
    operation_id="get_artifact",
    summary="Download an artifact",
    response_class=StreamingResponse,
    responses={
        200: {"description": "Its bytes.", "content": _BYTES, "headers": _HEADERS},
        206: {
            "description": "The bytes that `Range` asks for.",
            "content": _BYTES,
            "headers": {**_HEADERS, **_CONTENT_RANGE},
        },
        304: {"description": "You have it: `If-None-Match` names it."},
        **problem_responses(NotFoundError, RangeError, UnavailableError),
    },
)
def get_artifact(
    request: Request,
    parts: PartsDep,
    id: JobId,  # noqa: A002
    name: _Name,
    range_: Annotated[
        str | None,
        Header(
            alias="Range",
            description="One range of bytes. Default: all of them.",
            max_length=200,
            examples=["bytes=1024-"],
        ),
    ] = None,
    if_range: Annotated[
        str | None,
        Header(
            description="The `ETag` that the range belongs to; another one gets the whole. Default: none.",
            max_length=200,
            examples=['"9f86d081884c7d65..."'],
        ),
    ] = None,
    if_none_match: Annotated[
        str | None,
        Header(
            description="The `ETag` of what you have. Default: none.",
            max_length=1000,
            examples=['"9f86d081884c7d65..."'],
        ),
    ] = None,
) -> Response:
    """Streamed, whole or one range, so a broken download can go on."""
    artifact = _find(parts.record.artifacts(id), name)
    headers = _headers_of(artifact)
    if matches(if_none_match, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    part = requested_range(range_, if_range, headers["ETag"], artifact.size)
    start, end = (part.start, part.end) if part else (0, artifact.size)
    headers["Content-Length"] = str(end - start)
    if part:
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{artifact.size}"
    if request.method == "HEAD":
        return Response(status_code=206 if part else 200, headers=headers, media_type=artifact.content_type)
    # Opened here: an object that is not there is an error before the first byte.
    content = parts.store.stream(artifact.key, start, end, _CHUNK)
    return StreamingResponse(content, 206 if part else 200, headers, artifact.content_type)


def _find(artifacts: list[Artifact], name: str) -> Artifact:
    for artifact in artifacts:
        if artifact.name == name:
            return artifact
    names = [artifact.name for artifact in artifacts]
    raise NotFoundError(
        f"The job has no artifact {name!r}.",
        advice=f"It has: {', '.join(names)}." if names else "Artifacts are there once the job is `succeeded`.",
        artifacts=names,
    )


def _headers_of(artifact: Artifact) -> dict[str, str]:
    digest = base64.b64encode(bytes.fromhex(artifact.sha256)).decode()
    return {
        "ETag": f'"{artifact.sha256}"',
        "Accept-Ranges": "bytes",
        "Cache-Control": "private, no-cache",
        "Content-Disposition": f'attachment; filename="{artifact.name}"',
        "Repr-Digest": f"sha-256=:{digest}:",
        "X-Content-Type-Options": "nosniff",
    }
