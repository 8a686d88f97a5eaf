"""List the artifacts of a job, stream their bytes, and sign URLs that grant read access to one."""

from __future__ import annotations

from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from meshdeform.api.jobs import ArtifactList, ArtifactView, SignedUrl
from meshdeform.errors import (
    AssetTooLargeError,
    AssetUnsupportedError,
    DependencyError,
    ForbiddenError,
    JobNotFinishedError,
    NotFoundError,
    ParameterError,
    StoredFileError,
    TooMuchStoredError,
    UnreadableJobError,
)
from meshdeform.record.models import Artifact, Job, JobState
from meshdeform.runs import kind_of
from meshdeform.support.files import result_name
from service.documentation.responses import CALLER_ERRORS, JobId
from service.downloads.making import made, makeable
from service.downloads.responses import (
    OPEN_TO_SIGNED,
    ConditionsDep,
    Download,
    ReaderDep,
    download,
    download_responses,
    signed_url,
)
from service.downloads.strengths import MAX_STRENGTH, STRENGTH_STEP
from service.http.auth import PrincipalDep, ViewerDep
from service.http.errors import problem_responses
from service.http.queries import KNOWN_QUERY
from service.state import AppState, AppStateDep

__all__ = ["router"]

router = APIRouter(prefix="/v1/jobs/{id}/artifacts", tags=["artifacts"], dependencies=KNOWN_QUERY)

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
        200: {
            "model": ArtifactList,
            "description": "The results. Until the job has succeeded, only a generated target.",
        },
        **problem_responses(NotFoundError, *CALLER_ERRORS),
    },
)
def list_artifacts(app: AppStateDep, viewer: ViewerDep, id: JobId) -> Response:  # noqa: A002 - the name in the path
    """All artifacts appear together when the job succeeds, and never change; others can be made later.

    Only a generated target is there before: when the fit begins.
    """
    found = [ArtifactView.of(artifact, id) for artifact in app.record.artifacts(id, viewer.owner_id)]
    return JSONResponse(ArtifactList(artifacts=found).model_dump(mode="json"))


async def _at_strength(
    app: AppStateDep,
    reader: ReaderDep,
    id: JobId,  # noqa: A002
    name: _Name,
    strength: Annotated[
        float | None,
        Query(
            description="Of `result.glb`: how far the shape goes from the source (0) towards the result (1), or beyond "
            "it (up to 1.5), in steps of 0.01. Made on the first request, without a new run. Default: the artifact as "
            "it is stored.",
            ge=0.0,
            le=MAX_STRENGTH,
            multiple_of=STRENGTH_STEP,
            examples=[0.6],
        ),
    ] = None,
) -> Download | None:
    """Return an artifact at another strength; None if the stored one is wanted."""
    if strength is None or strength == 1:
        return None
    if reader.owner_id is None:
        raise ForbiddenError("The link shows what is stored.", advice="Other strengths need an API key.")
    artifact = await to_thread.run_sync(_find, app, id, reader.owner_id, name)
    job = await to_thread.run_sync(app.record.get, id, reader.owner_id)
    key, found = await app.strengths.get(job, artifact, strength)
    stem, dot, ending = _file_name(job, artifact).rpartition(".")
    saved_as = f"{stem}-strength{round(100 * strength)}{dot}{ending}"
    return Download(key, saved_as, artifact.content_type, found.size, found.sha256)


@router.head("/{name}", include_in_schema=False, openapi_extra=OPEN_TO_SIGNED)
@router.get(
    "/{name}",
    operation_id="get_artifact",
    summary="Download an artifact",
    response_class=StreamingResponse,
    responses={
        **download_responses(
            "`Content-Type` is the artifact's `content_type`, such as `model/gltf-binary`, `application/json` for "
            "`report.json`, or `image/png` for `preview.png`."
        ),
        **problem_responses(ForbiddenError, JobNotFinishedError, UnreadableJobError, ParameterError, DependencyError),
    },
    openapi_extra=OPEN_TO_SIGNED,
)
def get_artifact(
    request: Request,
    app: AppStateDep,
    reader: ReaderDep,
    id: JobId,  # noqa: A002
    name: _Name,
    conditions: ConditionsDep,
    at_strength: Annotated[Download | None, Depends(_at_strength)],
) -> Response:
    """Streamed, whole or as one range, so an interrupted download can resume. A signed URL needs no API key."""
    if at_strength is not None:
        return download(request, app, at_strength, conditions)
    artifact = _find(app, id, reader.owner_id, name)
    saved_as = _file_name(app.record.get(id, reader.owner_id), artifact)
    found = Download(artifact.key, saved_as, artifact.content_type, artifact.size, artifact.sha256)
    return download(request, app, found, conditions, signed=reader.owner_id is None and not reader.link)


@router.post(
    "/{name}",
    operation_id="make_artifact",
    summary="Make an artifact that the job was not asked for",
    responses={
        200: {"model": ArtifactView, "description": "The artifact, which the job has from now on."},
        **problem_responses(
            NotFoundError,
            JobNotFinishedError,
            AssetTooLargeError,
            AssetUnsupportedError,
            TooMuchStoredError,
            DependencyError,
            StoredFileError,
            *CALLER_ERRORS,
        ),
    },
)
async def make_artifact(app: AppStateDep, principal: PrincipalDep, id: JobId, name: _Name) -> Response:  # noqa: A002
    """Makes `morph.glb` or `result.stl` of a job that has succeeded, once."""
    artifact = await app.take_in(principal.owner_id, _make, app, id, principal.owner_id, name)
    return JSONResponse(ArtifactView.of(artifact, id).model_dump(mode="json"))


@router.post(
    "/{name}/url",
    operation_id="sign_artifact",
    summary="Create a signed URL for an artifact",
    responses={
        200: {"model": SignedUrl, "description": "The URL."},
        **problem_responses(NotFoundError, JobNotFinishedError, *CALLER_ERRORS),
    },
)
def sign_artifact(app: AppStateDep, principal: PrincipalDep, id: JobId, name: _Name) -> Response:  # noqa: A002
    """Anyone who has the URL can read this one artifact without an API key, for example a browser or a viewer."""
    artifact = _find(app, id, principal.owner_id, name)
    found = signed_url(app, f"/v1/jobs/{id}/artifacts/{name}", artifact)
    return JSONResponse(found.model_dump(mode="json"), headers={"Cache-Control": "no-store"})


def _file_name(job: Job, artifact: Artifact) -> str:
    filenames = {part: file.filename for part, file in job.files.items()}
    try:
        goal = kind_of(job.request.kind).goal(job.request, filenames)
        seed = getattr(job.request.params, "seed", None)  # a kind of job may have none
    except UnreadableJobError:
        goal, seed = job.prompt, None
    return result_name(artifact.name, source=job.source.filename, goal=goal, seed=seed)


def _make(app: AppState, job_id: str, owner: str, name: str) -> Artifact:
    job = app.record.get(job_id, owner)
    known = any(artifact.name == name for artifact in job.artifacts)
    if known or job.state is not JobState.SUCCEEDED or name not in makeable(job):
        return _find(app, job_id, owner, name)
    return made(app, job, name)


def _find(app: AppState, job_id: str, owner: str | None, name: str) -> Artifact:
    job = app.record.get(job_id, owner)
    artifacts = {artifact.name: artifact for artifact in app.record.artifacts(job_id, owner)}
    if name in artifacts:
        return artifacts[name]
    state = job.state.value
    if not job.state.terminal:
        raise JobNotFinishedError(f"The job is {state}: it has no artifacts yet.", state=state)
    if job.state is JobState.SUCCEEDED:
        has = f"It has: {', '.join(artifacts)}."
        if name in makeable(job):
            has += f" Make it: POST /v1/jobs/{job_id}/artifacts/{name}."
        raise NotFoundError(f"The job has no artifact {name!r}.", advice=has, artifacts=list(artifacts))
    happened = {
        JobState.FAILED: f"The job failed: {job.error.detail}" if job.error else "The job failed.",
        JobState.CANCELED: "The job was canceled.",
        JobState.EXPIRED: "The job expired before it finished.",
    }
    raise NotFoundError(
        f"There is no artifact {name!r}. {happened[job.state]}",
        advice="Only a job that succeeded has artifacts. Retry this one: POST /v1/jobs/{id}/retry.",
        state=state,
        artifacts=[],
    )
