"""Create links that show one job without an API key."""

from __future__ import annotations

from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse

from meshdeform.api.jobs import SignedUrl
from meshdeform.errors import NotFoundError
from service.documentation.responses import CALLER_ERRORS, JobId
from service.http.auth import PrincipalDep, job_link
from service.http.errors import problem_responses
from service.http.queries import KNOWN_QUERY
from service.state import AppStateDep

__all__ = ["router"]

router = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=KNOWN_QUERY)


@router.post(
    "/{id}/url",
    operation_id="link_job",
    summary="Create a link to a job",
    responses={
        200: {"model": SignedUrl, "description": "The address of the page that shows the job."},
        **problem_responses(NotFoundError, *CALLER_ERRORS),
    },
)
def link_job(app: AppStateDep, principal: PrincipalDep, id: JobId) -> Response:  # noqa: A002 - the name in the path
    """Anyone who has the link can watch this one job, and read its asset, its checkpoints and its results.

    It changes nothing and opens no other job. It ends with its time, with the job, and with the API key that made it.
    """
    job = app.record.get(id, principal.owner_id)
    if app.settings.web == "off":
        raise NotFoundError(
            "This deployment serves no page that a link could open.",
            advice="Create signed URLs of single artifacts, or ask its operator for MESHDEFORM_WEB.",
        )
    found = job_link(app, job.id, principal.key_id)
    return JSONResponse(found.model_dump(mode="json"), headers={"Cache-Control": "no-store"})
