"""Return the limits of this server, so that clients can check requests in advance."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import JSONResponse

from meshdeform.api.limits import IDLE_S, MAX_DOCUMENT_BYTES, MAX_FILENAME, MAX_KEY, MAX_PAGE, MAX_WAIT_S, MIN_BODY_RATE
from meshdeform.assets import Limits
from meshdeform.record.upkeep import IDEMPOTENCY_KEPT_S
from meshdeform.requests.document import (
    MAX_DEADLINE_S,
    MAX_METADATA_ENTRIES,
    MAX_METADATA_NAME,
    MAX_METADATA_VALUE,
    MAX_PRIORITY,
    MAX_PROMPT_LENGTH,
    MAX_RETENTION_S,
)
from meshdeform.runs import kinds
from meshdeform.runs.base import Kind
from service.documentation.responses import CALLER_ERRORS
from service.http.auth import PrincipalDep
from service.http.errors import problem_responses
from service.http.queries import KNOWN_QUERY
from service.schemas import (
    ArtifactKindView,
    FileLimits,
    FilePartView,
    JobLimits,
    KindView,
    LimitList,
    RequestLimits,
    UploadLimits,
)
from service.state import AppStateDep

__all__ = ["router"]

router = APIRouter(prefix="/v1/limits", tags=["limits"], dependencies=KNOWN_QUERY)
_FORMATS = ["glb", "obj", "ply", "stl", "zip"]


@router.get(
    "",
    operation_id="get_limits",
    summary="Get the limits of this server",
    responses={
        200: {"model": LimitList, "description": "The limits of everything that a caller controls."},
        **problem_responses(*CALLER_ERRORS),
    },
)
async def get_limits(app: AppStateDep, principal: PrincipalDep) -> JSONResponse:
    """Includes the limits of the API key that is used."""
    settings, limits = app.settings, Limits.from_settings(app.settings)
    found = LimitList(
        files=FileLimits(
            formats=_FORMATS,
            max_bytes=limits.max_bytes,
            max_json_bytes=limits.max_json_bytes,
            max_json_values=limits.max_json_values,
            max_json_depth=limits.max_json_depth,
            max_accessor_elements=limits.max_accessor_elements,
            max_triangles=limits.max_triangles,
            max_vertices=limits.max_vertices,
            max_primitives=limits.max_primitives,
            max_check_bytes=limits.max_memory_bytes,
            max_check_s=limits.max_check_s,
        ),
        jobs=JobLimits(
            max_document_bytes=MAX_DOCUMENT_BYTES,
            max_steps=settings.max_steps,
            max_prompt_characters=MAX_PROMPT_LENGTH,
            max_filename_characters=MAX_FILENAME,
            max_metadata_entries=MAX_METADATA_ENTRIES,
            max_metadata_name_characters=MAX_METADATA_NAME,
            max_metadata_value_characters=MAX_METADATA_VALUE,
            min_priority=-MAX_PRIORITY,
            max_priority=principal.max_priority,
            max_deadline_s=MAX_DEADLINE_S,
            max_retention_s=MAX_RETENTION_S,
            max_stored_bytes=settings.max_stored_bytes or None,
            default_retention_s=settings.retention_s or None,
        ),
        requests=RequestLimits(
            requests_per_minute=principal.requests_per_minute or None,
            max_active_jobs=principal.max_active_jobs or None,
            max_page=MAX_PAGE,
            max_wait_s=MAX_WAIT_S,
            max_idempotency_key_characters=MAX_KEY,
            idempotency_kept_s=IDEMPOTENCY_KEPT_S,
            max_bodies_at_once=app.bodies.total,
            max_own_bodies_at_once=app.bodies.per_owner,
            max_body_idle_s=IDLE_S,
            min_body_rate=MIN_BODY_RATE,
        ),
        uploads=UploadLimits(
            max_bytes=settings.max_upload_bytes,
            max_uploads=settings.max_uploads or None,
            max_uploads_bytes=settings.max_uploads_bytes or None,
            ttl_s=settings.upload_ttl_s,
            signed_url_ttl_s=settings.signed_url_ttl_s,
        ),
        kinds=[_described(kind) for kind in kinds()],
    )
    return JSONResponse(found.model_dump(mode="json"))


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
