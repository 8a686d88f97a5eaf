"""List the checkpoints of a job and download their meshes."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from meshdeform.api.jobs import CheckpointList, CheckpointView
from meshdeform.errors import NotFoundError
from meshdeform.record.models import CheckpointRef
from service.documentation.responses import CALLER_ERRORS, JobId
from service.downloads.responses import ConditionsDep, Download, download, download_responses
from service.http.auth import ViewerDep
from service.http.errors import problem_responses
from service.http.queries import KNOWN_QUERY
from service.state import AppState, AppStateDep

__all__ = ["router"]

_GLB = "model/gltf-binary"
router = APIRouter(prefix="/v1/jobs/{id}/checkpoints", tags=["checkpoints"], dependencies=KNOWN_QUERY)

_Step = Annotated[int, Path(description="Step of the checkpoint.", ge=0, le=2**31 - 1, examples=[500])]


@router.get(
    "",
    operation_id="list_checkpoints",
    summary="List a job's checkpoints",
    responses={
        200: {"model": CheckpointList, "description": "The checkpoints that are still stored, in order of steps."},
        **problem_responses(NotFoundError, *CALLER_ERRORS),
    },
)
def list_checkpoints(app: AppStateDep, viewer: ViewerDep, id: JobId) -> Response:  # noqa: A002 - the name in the path
    """Available in any state of the job. Only the newest checkpoints are kept; older ones are deleted."""
    found = [CheckpointView.of(checkpoint, id) for checkpoint in _checkpoints(app, id, viewer.owner_id)]
    return JSONResponse(CheckpointList(checkpoints=found).model_dump(mode="json"))


@router.head("/{step}/mesh.glb", include_in_schema=False)
@router.get(
    "/{step}/mesh.glb",
    operation_id="get_checkpoint_mesh",
    summary="Download the mesh of a checkpoint",
    response_class=StreamingResponse,
    responses=download_responses(f"`Content-Type` is `{_GLB}`."),
)
def get_checkpoint_mesh(
    request: Request,
    app: AppStateDep,
    viewer: ViewerDep,
    id: JobId,  # noqa: A002
    step: _Step,
    conditions: ConditionsDep,
) -> Response:
    """The asset with its shape at that step, also while the job is running. Streamed like an artifact."""
    checkpoints = _checkpoints(app, id, viewer.owner_id)
    for found in checkpoints:
        if found.step == step and found.mesh_key is not None:
            assert found.mesh_size is not None
            assert found.mesh_sha256 is not None
            mesh = Download(found.mesh_key, f"step-{step:06d}.glb", _GLB, found.mesh_size, found.mesh_sha256)
            return download(request, app, mesh, conditions)
    steps = [found.step for found in checkpoints if found.mesh_key is not None]
    raise NotFoundError(
        f"The job has no mesh of step {step}.",
        advice=f"There are meshes of steps {', '.join(map(str, steps))}." if steps else "It has no meshes yet.",
        steps=steps,
    )


def _checkpoints(app: AppState, job_id: str, owner: str | None) -> list[CheckpointRef]:
    """Return one checkpoint for each step, in order; where two attempts stored the same step, the newer attempt's."""
    app.record.get(job_id, owner)
    found: dict[int, CheckpointRef] = {}
    for checkpoint in app.record.leases.checkpoints(job_id):
        found.setdefault(checkpoint.step, checkpoint)
    return [found[step] for step in sorted(found)]
