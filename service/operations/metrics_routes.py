"""Export metrics to Prometheus."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from service.http.auth import PrincipalDep
from service.http.errors import problem_responses

__all__ = ["router"]

_EXAMPLE = 'meshdeform_jobs{state="queued"} 3.0\n'
router = APIRouter(tags=["health"])


@router.get(
    "/metrics",
    operation_id="metrics",
    summary="Get metrics for Prometheus",
    response_class=Response,
    responses={
        200: {
            "description": "Prometheus' text format.",
            "content": {"text/plain": {"schema": {"type": "string"}, "example": _EXAMPLE}},
        },
        **problem_responses(),
    },
)
def metrics(request: Request, principal: PrincipalDep) -> Response:
    """Jobs by state, queue and run times, recoveries, webhooks, requests. Requires an API key if keys are on."""
    del principal
    return Response(generate_latest(request.app.state.metrics.registry), media_type=CONTENT_TYPE_LATEST)
