"""Artifacts of a job: list them, stream their bytes, and give others a URL to read one."""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from meshdeform.api.jobs import ArtifactList, ArtifactView, SignedUrl
from meshdeform.errors import ForbiddenError, NotFoundError
from meshdeform.record.models import Artifact, Job
from meshdeform.support.file_names import result_name
from service.documentation.responses import CALLER_ERRORS, JobId
from service.downloads.responses import (
    OPEN_TO_SIGNED,
    ConditionsDep,
    Download,
    ReaderDep,
    download,
    download_responses,
    signed_url,
)
from service.http.auth import PrincipalDep
from service.http.errors import problem_responses
from service.state import AppStateDep

__all__ = ["router"]

router = APIRouter(prefix="/v1/jobs/{id}/artifacts", tags=["artifacts"])

_Name = Annotated[
    str,
    Path(
        description="The artifact's name.",
        min_length=1,
        max_length=128,
        pattern=r"^[A-Za-z0-9_.-]+$",
        examples=["result.glb"],
    ),
]


@router.get(
    "",
    operation_id="list_artifacts",
    summary="List a job's artifacts",
    responses={
        200: {"model": ArtifactList, "description": "The results; none before the job is `succeeded`."},
        **problem_responses(NotFoundError, *CALLER_ERRORS),
    },
)
def list_artifacts(app: AppStateDep, principal: PrincipalDep, id: JobId) -> Response:  # noqa: A002 - the path's own word
    """They come all at once, when the job has succeeded, and never change."""
    found = [ArtifactView.of(artifact, id) for artifact in app.record.artifacts(id, principal.owner_id)]
    return JSONResponse(ArtifactList(artifacts=found).model_dump(mode="json"))


@router.head("/{name}", include_in_schema=False)
@router.get(
    "/{name}",
    operation_id="get_artifact",
    summary="Download an artifact",
    response_class=StreamingResponse,
    responses={
        **download_responses(
            "model/gltf-binary", "model/vnd.usdz+zip", "application/json", "image/png", "application/octet-stream"
        ),
        **problem_responses(ForbiddenError),
    },
    openapi_extra=OPEN_TO_SIGNED,
)
def get_artifact(
    request: Request,
    app: AppStateDep,
    owner: ReaderDep,
    id: JobId,  # noqa: A002
    name: _Name,
    conditions: ConditionsDep,
) -> Response:
    """Streamed, whole or one range, so a broken download can go on. A signed URL needs no API key."""
    artifact = _find(app.record.artifacts(id, owner), name)
    saved_as = _file_name(app.record.get(id, owner), artifact)
    found = Download(artifact.key, saved_as, artifact.content_type, artifact.size, artifact.sha256)
    return download(request, app, found, conditions)


@router.post(
    "/{name}/url",
    operation_id="sign_artifact",
    summary="Make a URL that needs no API key",
    responses={
        200: {"model": SignedUrl, "description": "The URL."},
        **problem_responses(NotFoundError, *CALLER_ERRORS),
    },
)
def sign_artifact(app: AppStateDep, principal: PrincipalDep, id: JobId, name: _Name) -> Response:  # noqa: A002
    """For browsers, viewers and programs that carry no key: whoever has the URL may read this one artifact."""
    artifact = _find(app.record.artifacts(id, principal.owner_id), name)
    found = signed_url(app, f"/v1/jobs/{id}/artifacts/{name}", artifact)
    return JSONResponse(found.model_dump(mode="json"), headers={"Cache-Control": "no-store"})


def _file_name(job: Job, artifact: Artifact) -> str:
    goal = job.prompt or (f"like {PurePath(job.target.filename).stem}" if job.target else "")
    seed = getattr(job.params, "seed", None)  # a kind of job may have none
    return result_name(artifact.name, asset=job.asset.filename, goal=goal, seed=seed)


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
