"""Define responses, headers and parameters that several routes share in the OpenAPI document."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Path

from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetExternalError,
    AssetFormatError,
    AssetNotFetchedError,
    AssetNotFiniteError,
    AssetTooLargeError,
    AssetTruncatedError,
    AssetUnsupportedError,
    DrawingError,
    IdempotencyBusyError,
    IdempotencyMismatchError,
    LimitError,
    ModelError,
    ParameterError,
    PartNotFoundError,
    PromptError,
    RequestError,
    RequestTimeoutError,
    SilhouetteError,
    TooManyJobsError,
    TooMuchStoredError,
    UnauthorizedError,
    UnavailableError,
    VocabularyError,
    WebhookAddressError,
)
from meshdeform.record.ids import JOB_ID_PATTERN
from service.http.idempotency import REPLAYED

JobId = Annotated[
    str,
    Path(
        description="The job's id, as returned by `POST /v1/jobs`.",
        pattern=JOB_ID_PATTERN,
        examples=["job_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    ),
]

ASSET_ERRORS = (
    AssetTooLargeError,
    AssetFormatError,
    AssetError,
    AssetTruncatedError,
    AssetExternalError,
    AssetNotFetchedError,
    AssetUnsupportedError,
    AssetNotFiniteError,
    AssetEmptyError,
    SilhouetteError,
    DrawingError,
)
REQUEST_ERRORS = (RequestError, ParameterError, PromptError, VocabularyError, PartNotFoundError, ModelError)
CALLER_ERRORS = (UnauthorizedError, LimitError, UnavailableError)
"""Errors of every route that needs an API key."""

ONCE_ERRORS = (IdempotencyMismatchError, IdempotencyBusyError)
NEW_JOB_ERRORS = (*ONCE_ERRORS, TooManyJobsError, TooMuchStoredError, RequestTimeoutError, WebhookAddressError)

Step = Annotated[int, Path(description="Step of the checkpoint.", ge=0, le=2**31 - 1, examples=[500])]


def header(description: str, example: str | int) -> dict[str, Any]:
    """Return the OpenAPI description of a header of a response."""
    kind = "integer" if isinstance(example, int) else "string"
    return {"description": description, "schema": {"type": kind}, "example": example}


ETAG = {"ETag": header("Identifies this version of the job.", 'W/"7"')}
RETRY_AFTER = {"Retry-After": header("Seconds to wait before the next request.", 1)}
LOCATION = {"Location": header("The job's URL.", "/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6")}
REPLAY = {REPLAYED: header("`true` if this repeats the response to the first request with this key.", "true")}
WAITED = {"Preference-Applied": header("The longest wait that `Prefer` requested and the server granted.", "wait=30")}


def json_body(model: str, example: dict[str, Any]) -> dict[str, Any]:
    """Return the OpenAPI description of a body that is a JSON document."""
    content = {"schema": {"$ref": f"#/components/schemas/{model}"}, "example": example}
    return {"requestBody": {"required": True, "content": {"application/json": content}}}
