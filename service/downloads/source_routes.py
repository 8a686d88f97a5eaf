"""Download the input files of a job."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from fastapi.responses import StreamingResponse

from meshdeform.assets.inspect import asset_format
from meshdeform.errors import AssetEmptyError, AssetFormatError, NotFoundError
from meshdeform.record.models import Job, StoredFile
from service.documentation.responses import JobId
from service.downloads.responses import ConditionsDep, Download, download, download_responses
from service.http.auth import PrincipalDep, ViewerDep
from service.http.queries import KNOWN_QUERY
from service.state import AppState, AppStateDep

__all__ = ["router"]

router = APIRouter(prefix="/v1/jobs/{id}", tags=["jobs"], dependencies=KNOWN_QUERY)

_OTHER = "application/octet-stream"
# PLY has no registered type.
_TYPES = {
    "glb": "model/gltf-binary",
    "gltf": "model/gltf+json",
    "obj": "model/obj",
    "ply": _OTHER,
    "stl": "model/stl",
    "zip": "application/zip",
}
_RESPONSES = download_responses(
    f"`Content-Type` is one of {', '.join(f'`{each}`' for each in dict.fromkeys(_TYPES.values()))}."
)
_HEAD_BYTES = 64


_Part = Annotated[
    str,
    Path(
        description="The name of a part of the job's kind.",
        max_length=64,
        pattern="^[a-z][a-z0-9_]*$",
        examples=["asset"],
    ),
]


@router.head("/files/{part}", include_in_schema=False)
@router.get(
    "/files/{part}",
    operation_id="get_file",
    summary="Download a job's file",
    response_class=StreamingResponse,
    responses=_RESPONSES,
)
def get_file(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    id: JobId,  # noqa: A002 - the name in the path
    part: _Part,
    conditions: ConditionsDep,
) -> Response:
    """A file of a job of any kind as it was sent. Available in any state of the job, and streamed like an artifact."""
    return _download(request, app, _find(app.record.get(id, principal.owner_id), part), conditions)


@router.head("/asset", include_in_schema=False)
@router.get(
    "/asset",
    operation_id="get_asset",
    summary="Download a job's asset",
    response_class=StreamingResponse,
    responses=_RESPONSES,
)
def get_asset(
    request: Request,
    app: AppStateDep,
    viewer: ViewerDep,
    id: JobId,  # noqa: A002 - the name in the path
    conditions: ConditionsDep,
) -> Response:
    """The first of the job's files, which is the asset to deform."""
    return _download(request, app, app.record.get(id, viewer.owner_id).source, conditions)


@router.head("/target", include_in_schema=False)
@router.get(
    "/target",
    operation_id="get_target",
    summary="Download a job's target",
    response_class=StreamingResponse,
    responses=_RESPONSES,
)
def get_target(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    id: JobId,  # noqa: A002
    conditions: ConditionsDep,
) -> Response:
    """The second mesh of `target` guidance, the same as `GET /v1/jobs/{id}/files/target`; `404` if there is none."""
    return _download(request, app, _find(app.record.get(id, principal.owner_id), "target"), conditions)


def _find(job: Job, part: str) -> StoredFile:
    names = list(job.files)
    if part not in names:
        raise NotFoundError(f"The job has no file {part!r}.", advice=f"It has: {', '.join(names)}.", files=names)
    return job.files[part]


def _download(request: Request, app: AppState, file: StoredFile, conditions: ConditionsDep) -> Response:
    found = Download(file.key, file.filename, _content_type(app, file), file.size, file.sha256)
    return download(request, app, found, conditions)


def _content_type(app: AppState, file: StoredFile) -> str:
    """Return the media type by the rule that applied when the file was checked: its first bytes, then its name."""
    if file.filename.lower().endswith(".glb"):
        return _TYPES["glb"]  # a file with this name and other content was refused
    head: Iterator[bytes] = app.store.stream(file.key, 0, min(_HEAD_BYTES, file.size))
    try:
        return _TYPES[asset_format(b"".join(head), file.filename)]
    except (AssetFormatError, AssetEmptyError):
        return _OTHER
