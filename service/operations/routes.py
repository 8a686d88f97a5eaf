"""Report the models and limits of this server; and, for its operator, liveness, readiness and metrics."""

from __future__ import annotations

import asyncio
from dataclasses import asdict

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from meshdeform import __version__
from meshdeform.api.documents import (
    ArtifactKindView,
    FileLimits,
    FilePartView,
    JobLimits,
    KindView,
    LimitList,
    ModelList,
    ModelView,
    RequestLimits,
    UploadLimits,
    UsageList,
    UsageMonth,
    VocabularyView,
    WordLimits,
)
from meshdeform.assets import Limits
from meshdeform.errors import LimitError, UnauthorizedError
from meshdeform.priors.catalogue import list_models, shapes_vocabulary
from meshdeform.runs import kinds
from meshdeform.runs.base import Kind
from meshdeform.words import MAX_FACES, MAX_SHAPES, MAX_WORD_BYTES, parts_to_set
from service.documentation.responses import CALLER_ERRORS
from service.http.auth import PrincipalDep
from service.http.errors import KNOWN_QUERY, answers, problem_responses
from service.schemas import Health, PartHealth, Readiness
from service.state import AppStateDep
from service.words.known import as_word

router = APIRouter(dependencies=KNOWN_QUERY)
health = APIRouter(tags=["health"])
_FORMATS = ["glb", "obj", "ply", "stl", "3mf", "zip"]
_STORE_S = 5.0  # short, because probes ask every few seconds
_READY_S = 1.8  # less than probes usually wait
_SILENT = PartHealth(status="unavailable", detail="It does not answer.")
_EXAMPLE = 'meshdeform_jobs{state="queued"} 3.0\n'


@router.get(
    "/v1/models",
    tags=["models"],
    operation_id="list_models",
    summary="List the models that jobs may use",
    responses=answers(ModelList, "The models of this server, the default one first.", *CALLER_ERRORS),
)
def get_models(app: AppStateDep, principal: PrincipalDep) -> JSONResponse:
    """Each model with its availability and vocabulary. Prompts made of its words are accepted."""
    settings = app.settings
    own = {kept.noun: parts_to_set(as_word(kept)) for kept in app.record.words.all(principal.owner_id)}
    models = list_models(settings.model, settings.allowed_models, settings.model_revision, public=True)
    views = [ModelView.model_validate(asdict(model)) for model in models]
    shapes = VocabularyView.model_validate(asdict(shapes_vocabulary(own)))
    return JSONResponse(ModelList(default=views[0].id, shapes=shapes, models=views).model_dump(mode="json"))


@router.get(
    "/v1/limits",
    tags=["limits"],
    summary="Get the limits of this server",
    responses=answers(LimitList, "The limits of everything that a caller controls.", *CALLER_ERRORS),
)
async def get_limits(app: AppStateDep, principal: PrincipalDep) -> JSONResponse:
    """Includes the limits of the API key that is used."""
    settings, limits = app.settings, Limits.from_settings(app.settings)
    document = LimitList(
        files=FileLimits(
            formats=_FORMATS,
            max_bytes=limits.max_bytes,
            max_json_bytes=limits.max_json_bytes,
            max_accessor_elements=limits.max_accessor_elements,
            max_triangles=limits.max_triangles,
        ),
        jobs=JobLimits(
            max_steps=settings.max_steps,
            max_priority=principal.max_priority,
            max_run_s=settings.max_run_s or None,
            max_running_jobs=settings.max_running_jobs or None,
            max_stored_bytes=settings.max_stored_bytes or None,
            default_retention_s=settings.retention_s or None,
        ),
        requests=RequestLimits(
            requests_per_minute=principal.requests_per_minute or None,
            max_active_jobs=principal.max_active_jobs or None,
        ),
        uploads=UploadLimits(
            max_bytes=settings.max_upload_bytes,
            max_uploads=settings.max_uploads or None,
            max_uploads_bytes=settings.max_uploads_bytes or None,
            ttl_s=settings.upload_ttl_s,
            signed_url_ttl_s=settings.signed_url_ttl_s,
        ),
        words=WordLimits(
            max_words=settings.max_words,
            max_words_bytes=settings.max_words_bytes or None,
            max_meshes=MAX_SHAPES,
            max_faces=MAX_FACES,
            max_bytes=MAX_WORD_BYTES,
        ),
        kinds=[_described(kind) for kind in kinds()],
    )
    return JSONResponse(document.model_dump(mode="json"))


@router.get(
    "/v1/usage",
    tags=["usage"],
    summary="Get what you have used, by month",
    responses=answers(UsageList, "Jobs, seconds and bytes of each month.", *CALLER_ERRORS),
)
def get_usage(app: AppStateDep, principal: PrincipalDep) -> JSONResponse:
    """Of all keys of your owner together. Jobs that were deleted stay counted."""
    months = [
        UsageMonth(month=each.month, jobs=each.jobs, seconds=each.seconds, bytes=each.bytes)
        for each in app.record.usage.months(principal.owner_id)
    ]
    return JSONResponse(UsageList(months=months).model_dump(mode="json"), headers={"Cache-Control": "no-store"})


def _described(kind: Kind) -> KindView:
    return KindView(
        name=kind.name,
        summary=kind.summary,
        reads=[
            FilePartView(
                name=each.name, summary=each.summary, required=each.required, media_types=list(each.media_types)
            )
            for each in kind.reads
        ],
        params=kind.params.model_json_schema(),
        artifacts=[
            ArtifactKindView(name=each.name, media_type=each.media_type, summary=each.summary)
            for each in kind.artifacts
        ],
    )


@health.get(
    "/healthz",
    summary="Check liveness",
    responses=answers(Health, "The process is alive."),
)
async def healthz() -> JSONResponse:
    """Checks nothing else: an unavailable dependency must not cause a restart of this process."""
    return JSONResponse(Health(status="ok", version=__version__).model_dump())


@health.get(
    "/readyz",
    summary="Check whether the record, Redis and the object store respond",
    responses={
        200: {"model": Readiness, "description": "All of them respond."},
        503: {"model": Readiness, "description": "At least one does not respond."},
        **problem_responses(),
    },
)
async def readyz(app: AppStateDep) -> JSONResponse:
    """Returns the state of each of the three within 2 seconds. That of the object store is up to 2 seconds old."""
    answers = {
        "record": app.record_health.ask(app.record.ping),
        "redis": app.redis_health.ask(app.queue.ping),
        "store": app.store_health.ask(lambda: app.store.ping(_STORE_S)),
    }
    await asyncio.wait([asyncio.wrap_future(answer) for answer in answers.values()], timeout=_READY_S)
    statuses = {name: answer.result() if answer.done() else _SILENT for name, answer in answers.items()}
    ready = all(each.status == "ok" for each in statuses.values())
    readiness = Readiness(status="ok" if ready else "unavailable", **statuses)
    return JSONResponse(readiness.model_dump(), 200 if ready else 503, {"Cache-Control": "no-store"})


@health.get(
    "/metrics",
    summary="Get metrics for Prometheus",
    response_class=Response,
    responses={
        200: {
            "description": "Prometheus' text format.",
            "content": {"text/plain": {"schema": {"type": "string"}, "example": _EXAMPLE}},
        },
        **problem_responses(UnauthorizedError, LimitError),
    },
)
def metrics(request: Request, principal: PrincipalDep) -> Response:
    """Jobs by state, queue and run times, recoveries, webhooks, requests. Requires an API key if keys are on."""
    del principal
    return Response(generate_latest(request.app.state.metrics.registry), media_type=CONTENT_TYPE_LATEST)
