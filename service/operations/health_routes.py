"""Report liveness and readiness."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import APIRouter
from fastapi.responses import JSONResponse

from meshdeform import __version__
from meshdeform.errors import MeshdeformError
from service.http.errors import problem_responses
from service.schemas import Health, PartHealth, Readiness
from service.state import AppStateDep

__all__ = ["router"]

router = APIRouter(tags=["health"])
_STORE_S = 5.0  # short, because probes ask every few seconds


@router.get(
    "/healthz",
    operation_id="healthz",
    summary="Check liveness",
    responses={200: {"model": Health, "description": "The process is alive."}, **problem_responses()},
)
async def healthz() -> JSONResponse:
    """Checks nothing else: an unavailable dependency must not cause a restart of this process."""
    return JSONResponse(Health(status="ok", version=__version__).model_dump())


@router.get(
    "/readyz",
    operation_id="readyz",
    summary="Check whether the record, Redis and the object store respond",
    responses={
        200: {"model": Readiness, "description": "All of them respond."},
        503: {"model": Readiness, "description": "At least one does not respond."},
        **problem_responses(),
    },
)
def readyz(app: AppStateDep) -> JSONResponse:
    """Returns the state of each of the three. That of the object store is up to 2 seconds old."""
    found = {
        "record": _ask(app.record.ping),
        "redis": _ask(app.queue.ping),
        "store": app.store_health.get(lambda: _ask(lambda: app.store.ping(_STORE_S))),
    }
    ready = all(part.status == "ok" for part in found.values())
    readiness = Readiness(status="ok" if ready else "unavailable", **found)
    return JSONResponse(readiness.model_dump(), 200 if ready else 503, {"Cache-Control": "no-store"})


def _ask(ping: Callable[[], None]) -> PartHealth:
    try:
        ping()
    except MeshdeformError as error:
        return PartHealth(status="unavailable", detail=error.detail)
    return PartHealth(status="ok")
