"""Find the side of an asset that a job would make the front, before it is created."""

from __future__ import annotations

from anyio import to_thread

from meshdeform.errors import ParameterError
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.runs.orientation_process import check_searchable, orientation_of
from service.http.bodies import ReceivedFile
from service.jobs.intake import check_job, check_params
from service.jobs.sources import Submission
from service.schemas import FoundOrientation
from service.state import AppState

__all__ = ["orient"]

_TIMEOUT_S = 240.0


async def orient(app: AppState, owner_id: str, submission: Submission) -> FoundOrientation:
    """Check a job as `validate` does, and search its front in a child process.

    Raises
    ------
    AssetError, RequestError, ModelError
        The job would not be accepted, or would not search its front.
    DependencyError, UnavailableError
        This server cannot search it, or cannot search it now.
    """
    params, asset = await app.take_in(owner_id, _checked, app, owner_id, submission)
    async with app.orienting.slot(owner_id):
        return await to_thread.run_sync(_found, app, submission.document, params, asset)


def _checked(app: AppState, owner_id: str, submission: Submission) -> tuple[ResolvedParams, ReceivedFile]:
    params = check_params(submission.document, app.settings, files=submission.names)
    if not isinstance(params, ResolvedParams):
        raise ParameterError("Jobs of this kind have no front.")
    check_searchable(params)  # before the files are decoded
    _, files, _ = check_job(app, owner_id, submission)
    return params, files["asset"]


def _found(app: AppState, request: JobRequest, params: ResolvedParams, asset: ReceivedFile) -> FoundOrientation:
    found = orientation_of(
        asset.path,
        asset.filename,
        request.prompt,
        params,
        subdivide=request.output.subdivide,
        limits=app.assets.limits,
        dtype=app.settings.dtype,
        timeout_s=_TIMEOUT_S,
    )
    return FoundOrientation(**found)
