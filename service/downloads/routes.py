"""Download the files of a job: its artifacts, which URLs can be signed for, its checkpoints and its input files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path as FilePath
from typing import Annotated, Literal

from anyio import to_thread
from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from meshdeform.api.jobs import ArtifactList, ArtifactView, CheckpointList, CheckpointView, SignedUrl
from meshdeform.api.limits import MAX_FILENAME
from meshdeform.assets.inspect import asset_format
from meshdeform.assets.pose import Pose
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetFormatError,
    AssetTooLargeError,
    AssetUnsupportedError,
    DependencyError,
    ForbiddenError,
    JobNotFinishedError,
    KindRetiredError,
    NotFoundError,
    ParameterError,
    RequestError,
    RequestTimeoutError,
    StoredFileError,
    TooMuchStoredError,
    UnreadableJobError,
)
from meshdeform.record.models import Artifact, CheckpointRef, Job, JobState, StoredFile
from meshdeform.runs import kind_of
from meshdeform.runs.base import RESULT
from meshdeform.support.files import result_name
from service.documentation.responses import BYTES, CALLER_ERRORS, JobId, Step, bytes_body
from service.downloads.making import deformed_alike, made, makeable
from service.downloads.responses import (
    OPEN_TO_SIGNED,
    ConditionsDep,
    Download,
    ReaderDep,
    download,
    download_responses,
    signed_url,
)
from service.downloads.variants import MAX_STRENGTH, STRENGTH_STEP, Variant
from service.http.auth import PrincipalDep
from service.http.bodies import receive_file
from service.http.errors import KNOWN_QUERY, answers, problem_responses
from service.http.forms import clean_filename
from service.http.links import ViewerDep
from service.state import AppState, AppStateDep

artifacts = APIRouter(prefix="/v1/jobs/{id}/artifacts", tags=["artifacts"], dependencies=KNOWN_QUERY)
checkpoints = APIRouter(prefix="/v1/jobs/{id}/checkpoints", tags=["checkpoints"], dependencies=KNOWN_QUERY)
sources = APIRouter(prefix="/v1/jobs/{id}", tags=["jobs"], dependencies=KNOWN_QUERY)

_GLB = "model/gltf-binary"
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
_Field = Annotated[
    str,
    Path(
        description="The name of a field of the job's kind.",
        max_length=64,
        pattern="^[a-z][a-z0-9_]*$",
        examples=["asset"],
    ),
]
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


# Artifacts


@artifacts.get(
    "",
    summary="List a job's artifacts",
    responses=answers(ArtifactList, "The results; none until the job has succeeded.", NotFoundError, *CALLER_ERRORS),
)
def list_artifacts(app: AppStateDep, viewer: ViewerDep, id: JobId) -> Response:
    """All artifacts appear together when the job succeeds, and never change; others can be made later."""
    views = [ArtifactView.of(artifact, id) for artifact in app.record.artifacts(id, viewer.owner_id)]
    return JSONResponse(ArtifactList(artifacts=views).model_dump(mode="json"))


async def _variant(
    app: AppStateDep,
    reader: ReaderDep,
    id: JobId,
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
    pose: Annotated[
        str | None,
        Query(
            description="Of `result.glb` and its other formats: the asset as it stands at a moment of an animation, "
            "`CLIP@SECONDS`, without skins, morph targets and animations. A clip is named by its name, or by its "
            "number from 0. Made on the first request. Default: the artifact as it is stored.",
            max_length=300,
            pattern="@",
            examples=["Run@0.5"],
        ),
    ] = None,
) -> Download | None:
    """Return an artifact at another strength or in a pose; None if the stored one is wanted."""
    if pose is not None and strength is not None:
        raise ParameterError.at(["query", "pose"], "A strength has no poses.", "Give only one of strength and pose.")
    if pose is None and (strength is None or strength == 1):
        return None
    if reader.owner_id is None:
        raise ForbiddenError("The link shows what is stored.", advice="Other strengths and poses need an API key.")
    if pose is not None:
        pose = str(Pose.parse(pose))
    # A pose is made of the result, also where its format is no artifact yet.
    artifact = await to_thread.run_sync(_find, app, id, reader.owner_id, name if pose is None else RESULT)
    job = await to_thread.run_sync(app.record.get, id, reader.owner_id)
    variant = Variant(name, strength, pose)
    made = await app.variants.get(job, artifact, variant)
    kind = next(kind for kind in kind_of(job.request.kind).artifacts if kind.name == name)
    plain = _file_name(job, artifact.model_copy(update={"name": name}))
    stem, ending = plain.removesuffix(name.removeprefix("result")), name.removeprefix("result")
    saved_as = f"{stem}-{variant.tag}{ending}"
    return Download(made.key, saved_as, kind.media_type, made.stored.size, made.stored.sha256, tuple(made.warnings))


@artifacts.head("/{name}", include_in_schema=False, openapi_extra=OPEN_TO_SIGNED)
@artifacts.get(
    "/{name}",
    summary="Download an artifact",
    response_class=StreamingResponse,
    responses={
        **download_responses(
            "`Content-Type` is the artifact's `content_type`, such as `model/gltf-binary`, `application/json` for "
            "`report.json`, or `image/png` for `preview.png`."
        ),
        **problem_responses(
            ForbiddenError,
            JobNotFinishedError,
            UnreadableJobError,
            KindRetiredError,
            ParameterError,
            DependencyError,
        ),
    },
    openapi_extra=OPEN_TO_SIGNED,
)
def get_artifact(
    request: Request,
    app: AppStateDep,
    reader: ReaderDep,
    id: JobId,
    name: _Name,
    conditions: ConditionsDep,
    variant: Annotated[Download | None, Depends(_variant)],
) -> Response:
    """Streamed, whole or as one range, so an interrupted download can resume. A signed URL needs no API key."""
    if variant is not None:
        return download(request, app, variant, conditions)
    artifact = _find(app, id, reader.owner_id, name)
    saved_as = _file_name(app.record.get(id, reader.owner_id), artifact)
    told = tuple(artifact.warnings or ())
    file = Download(artifact.key, saved_as, artifact.content_type, artifact.size, artifact.sha256, told)
    return download(request, app, file, conditions)


@artifacts.post(
    "/{name}",
    summary="Make an artifact that the job was not asked for",
    responses=answers(
        ArtifactView,
        "The artifact, which the job has from now on.",
        NotFoundError,
        JobNotFinishedError,
        AssetTooLargeError,
        AssetUnsupportedError,
        TooMuchStoredError,
        DependencyError,
        StoredFileError,
        *CALLER_ERRORS,
    ),
)
async def make_artifact(app: AppStateDep, principal: PrincipalDep, id: JobId, name: _Name) -> Response:
    """Makes `morph.glb`, `map.safetensors` or another format of `result.glb` for a job that has succeeded, once."""
    artifact = await app.take_in(principal.owner_id, _make, app, id, principal.owner_id, name)
    return JSONResponse(ArtifactView.of(artifact, id).model_dump(mode="json"))


@artifacts.post(
    "/{name}/url",
    summary="Create a signed URL for an artifact",
    responses=answers(SignedUrl, "The URL.", NotFoundError, JobNotFinishedError, *CALLER_ERRORS),
)
def sign_artifact(app: AppStateDep, principal: PrincipalDep, id: JobId, name: _Name) -> Response:
    """Anyone who has the URL can read this one artifact without an API key, for example a browser or a viewer."""
    artifact = _find(app, id, principal.owner_id, name)
    link = signed_url(app, f"/v1/jobs/{id}/artifacts/{name}", artifact)
    return JSONResponse(link.model_dump(mode="json"), headers={"Cache-Control": "no-store"})


def _file_name(job: Job, artifact: Artifact) -> str:
    filenames = {name: file.filename for name, file in job.files.items()}
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


# Checkpoints


@checkpoints.get(
    "",
    summary="List a job's checkpoints",
    responses=answers(
        CheckpointList, "The checkpoints that are still stored, in order of steps.", NotFoundError, *CALLER_ERRORS
    ),
)
def list_checkpoints(app: AppStateDep, viewer: ViewerDep, id: JobId) -> Response:
    """Available in any state of the job. Only the newest checkpoints are kept; older ones are deleted."""
    views = [CheckpointView.of(checkpoint, id) for checkpoint in _checkpoints(app, id, viewer.owner_id)]
    return JSONResponse(CheckpointList(checkpoints=views).model_dump(mode="json"))


@checkpoints.head("/{step}/mesh.glb", include_in_schema=False)
@checkpoints.get(
    "/{step}/mesh.glb",
    summary="Download the mesh of a checkpoint",
    response_class=StreamingResponse,
    responses=download_responses(f"`Content-Type` is `{_GLB}`."),
)
def get_checkpoint_mesh(
    request: Request,
    app: AppStateDep,
    viewer: ViewerDep,
    id: JobId,
    step: Step,
    conditions: ConditionsDep,
) -> Response:
    """The asset with its shape at that step, also while the job is running. Streamed like an artifact."""
    stored = _checkpoints(app, id, viewer.owner_id)
    for checkpoint in stored:
        if checkpoint.step == step and checkpoint.mesh_key is not None:
            assert checkpoint.mesh_size is not None
            assert checkpoint.mesh_sha256 is not None
            mesh = Download(
                checkpoint.mesh_key, f"step-{step:06d}.glb", _GLB, checkpoint.mesh_size, checkpoint.mesh_sha256
            )
            return download(request, app, mesh, conditions)
    steps = [checkpoint.step for checkpoint in stored if checkpoint.mesh_key is not None]
    raise NotFoundError(
        f"The job has no mesh of step {step}.",
        advice=f"There are meshes of steps {', '.join(map(str, steps))}." if steps else "It has no meshes yet.",
        steps=steps,
    )


def _checkpoints(app: AppState, job_id: str, owner: str | None) -> list[CheckpointRef]:
    """Return one checkpoint for each step, in order; where two attempts stored the same step, the newer attempt's."""
    app.record.get(job_id, owner)
    by_step: dict[int, CheckpointRef] = {}
    for checkpoint in app.record.leases.checkpoints(job_id):
        by_step.setdefault(checkpoint.step, checkpoint)
    return [by_step[step] for step in sorted(by_step)]


# Input files


@sources.head("/files/{part}", include_in_schema=False)
@sources.get(
    "/files/{part}",
    summary="Download a job's file",
    response_class=StreamingResponse,
    responses=_RESPONSES,
)
def get_file(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    id: JobId,
    part: _Field,
    conditions: ConditionsDep,
) -> Response:
    """A file of a job of any kind as it was sent. Available in any state of the job, and streamed like an artifact."""
    return _download(request, app, _file_of(app.record.get(id, principal.owner_id), part), conditions)


@sources.head("/asset", include_in_schema=False)
@sources.get(
    "/asset",
    summary="Download a job's asset",
    response_class=StreamingResponse,
    responses=_RESPONSES,
)
def get_asset(
    request: Request,
    app: AppStateDep,
    viewer: ViewerDep,
    id: JobId,
    conditions: ConditionsDep,
) -> Response:
    """The first of the job's files, which is the asset to deform."""
    return _download(request, app, app.record.get(id, viewer.owner_id).source, conditions)


@sources.post(
    "/apply",
    summary="Deform another file as the job's asset was",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "The file as a GLB, with its new shape.",
            "content": BYTES,
        },
        **problem_responses(
            AssetError,
            ParameterError,
            RequestError,
            RequestTimeoutError,
            NotFoundError,
            JobNotFinishedError,
            StoredFileError,
            TooMuchStoredError,
            DependencyError,
            UnreadableJobError,
            KindRetiredError,
            *CALLER_ERRORS,
        ),
    },
    openapi_extra=bytes_body("A file that a job may deform."),
)
async def apply_job(
    request: Request,
    app: AppStateDep,
    principal: PrincipalDep,
    id: JobId,
    filename: Annotated[
        str,
        Query(
            description="The file's name. Its extension distinguishes OBJ, PLY and STL.",
            max_length=MAX_FILENAME,
            examples=["lod1.glb"],
        ),
    ] = "asset.glb",
    outside: Annotated[
        Literal["refuse", "rigid"],
        Query(
            description="Treatment of connected pieces that reach out of the box around the job's asset: the "
            "request is refused, or they are carried along and keep their shape.",
            examples=["rigid"],
        ),
    ] = "refuse",
) -> Response:
    """For levels of detail, collision meshes, clothes and props, which lie where the asset does. Without a new run.

    The first request makes `map.safetensors`, which is then an artifact of the job.
    """
    with ExitStack() as stack:
        folder = stack.enter_context(app.workspace.temporary_folder())
        job = await to_thread.run_sync(_succeeded, app, id, principal.owner_id)
        async with app.bodies.slot(principal.owner_id):
            most, file = app.settings.max_upload_bytes, folder / "asset"
            await receive_file(request, file, most, AssetTooLargeError.more_than(most))
        async with app.variants.slot(principal.owner_id):
            made_file = await to_thread.run_sync(deformed_alike, app, job, file, clean_filename(filename), outside)
        return StreamingResponse(_streamed(made_file, stack.pop_all()), media_type="application/octet-stream")


def _succeeded(app: AppState, job_id: str, owner: str) -> Job:
    job = app.record.get(job_id, owner)
    if job.state is not JobState.SUCCEEDED:
        _find(app, job_id, owner, "result.glb")
    return job


def _streamed(path: FilePath, held: ExitStack) -> Iterator[bytes]:
    with held, path.open("rb") as file:
        while chunk := file.read(1 << 18):
            yield chunk


def _file_of(job: Job, name: str) -> StoredFile:
    names = list(job.files)
    if name not in names:
        raise NotFoundError(f"The job has no file {name!r}.", advice=f"It has: {', '.join(names)}.", files=names)
    return job.files[name]


def _download(request: Request, app: AppState, file: StoredFile, conditions: ConditionsDep) -> Response:
    file_to_send = Download(file.key, file.filename, _content_type(app, file), file.size, file.sha256)
    return download(request, app, file_to_send, conditions)


def _content_type(app: AppState, file: StoredFile) -> str:
    """Return the media type by the rule that applied when the file was checked: its first bytes, then its name."""
    if file.filename.lower().endswith(".glb"):
        return _TYPES["glb"]  # a file with this name and other content was refused
    head: Iterator[bytes] = app.store.stream(file.key, 0, min(_HEAD_BYTES, file.size))
    try:
        return _TYPES[asset_format(b"".join(head), file.filename)]
    except (AssetFormatError, AssetEmptyError):
        return _OTHER
