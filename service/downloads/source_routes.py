"""Download the input files of a job."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import APIRouter, Request, Response
from fastapi.responses import StreamingResponse

from meshdeform.assets.inspect import asset_format
from meshdeform.errors import AssetFormatError, NotFoundError
from meshdeform.record.models import StoredFile
from service.documentation.responses import JobId
from service.downloads.responses import ConditionsDep, Download, download, download_responses
from service.http.auth import PrincipalDep
from service.http.queries import KNOWN_QUERY
from service.state import AppState, AppStateDep

__all__ = ["router"]

router = APIRouter(prefix="/v1/jobs/{id}", tags=["jobs"], dependencies=KNOWN_QUERY)

_OTHER = "application/octet-stream"
# PLY has no registered type.
_TYPES = {"glb": "model/gltf-binary", "gltf": "model/gltf+json", "obj": "model/obj", "ply": _OTHER, "stl": "model/stl"}
_RESPONSES = download_responses(
    f"`Content-Type` is one of {', '.join(f'`{each}`' for each in dict.fromkeys(_TYPES.values()))}."
)
_HEAD_BYTES = 64


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
    principal: PrincipalDep,
    id: JobId,  # noqa: A002 - the name in the path
    conditions: ConditionsDep,
) -> Response:
    """The file as it was sent. Available in any state of the job, and streamed like an artifact."""
    job = app.record.get(id, principal.owner_id)
    return download(request, app, _sent(app, job.asset), conditions)


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
    """The second mesh of `target` guidance, as it was sent; `404` if the job has none."""
    job = app.record.get(id, principal.owner_id)
    if job.target is None:
        raise NotFoundError("The job has no target.", advice="Only jobs with `target` guidance have one.")
    return download(request, app, _sent(app, job.target), conditions)


def _sent(app: AppState, file: StoredFile) -> Download:
    return Download(file.key, file.filename, _content_type(app, file), file.size, file.sha256)


def _content_type(app: AppState, file: StoredFile) -> str:
    """Return the media type by the rule that applied when the file was checked: its first bytes, then its name."""
    if file.filename.lower().endswith(".glb"):
        return _TYPES["glb"]  # a file with this name and other content was refused
    head: Iterator[bytes] = app.store.stream(file.key, 0, min(_HEAD_BYTES, file.size))
    try:
        return _TYPES[asset_format(b"".join(head), file.filename)]
    except AssetFormatError:
        return _OTHER
