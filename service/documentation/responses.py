"""Define responses, headers and parameters that several routes share in the OpenAPI document."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import FastAPI, Path
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

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
    KindRetiredError,
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
from meshdeform.requests.document import PARAMS_OF_KIND, JobKind
from meshdeform.requests.kind_folders import kind_modules
from meshdeform.serving import DEFAULT_URL
from service.http.idempotency import REPLAYED
from service.jobs.documents import (
    BranchDocument,
    JobDocument,
    PreviewDocument,
    RetryDocument,
    UploadCompletion,
    UploadDocument,
)
from service.schemas import Problem

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
REQUEST_ERRORS = (
    RequestError,
    ParameterError,
    PromptError,
    VocabularyError,
    PartNotFoundError,
    ModelError,
    KindRetiredError,
)
CALLER_ERRORS = (UnauthorizedError, LimitError, UnavailableError)
"""Errors of every route that needs an API key."""

ONCE_ERRORS = (IdempotencyMismatchError, IdempotencyBusyError)
NEW_JOB_ERRORS = (*ONCE_ERRORS, TooManyJobsError, TooMuchStoredError, RequestTimeoutError, WebhookAddressError)

Step = Annotated[int, Path(description="Step of the checkpoint.", ge=0, le=2**31 - 1, examples=[500])]
# Documents missing from the routes' signatures: bodies that are streamed, and problems.
_MODELS = (
    JobDocument,
    PreviewDocument,
    BranchDocument,
    RetryDocument,
    UploadDocument,
    UploadCompletion,
    Problem,
)
_REFERENCE = "#/components/schemas/{model}"
BYTES = {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}
"""The content of bodies that are bytes. Code generators know no other media type for them."""
# `format: binary` comes from OpenAPI 3.0; code generators still rely on it to recognise files.
FILE = {"type": "string", "format": "binary", "contentMediaType": "application/octet-stream"}
_DESCRIPTION = (
    "Post an asset and a prompt as a job, follow it, and download its results. Every error is a problem document "
    "(RFC 9457) with a stable code and advice. The guide is docs/http.md."
)
_SERVERS = [
    {"url": "/", "description": "The server of this document."},
    {"url": DEFAULT_URL, "description": "A server started with `meshdeform serve`."},
]
_TAGS = [
    {"name": "jobs", "description": "A job deforms one asset: post it, follow it, cancel it, delete it."},
    {"name": "uploads", "description": "Files uploaded before their jobs, in pieces if needed."},
    {"name": "events", "description": "The events of a job as they happen: docs/http.md#events."},
    {"name": "checkpoints", "description": "The steps from which a job can continue, and its mesh at each."},
    {"name": "artifacts", "description": "The results of a job."},
    {"name": "webhooks", "description": "Receive events as signed messages: docs/webhooks.md."},
    {"name": "models", "description": "The models that jobs may use in `params.guidance.model`."},
    {"name": "limits", "description": "The limits of this server."},
    {"name": "usage", "description": "What you have used."},
    {"name": "health", "description": "Liveness, readiness and metrics, for the operator."},
]


def header(description: str, example: str | int) -> dict[str, Any]:
    """Return the OpenAPI description of a header of a response."""
    kind = "integer" if isinstance(example, int) else "string"
    return {"description": description, "schema": {"type": kind}, "example": example}


ETAG = {"ETag": header("Identifies this version of the job.", 'W/"7"')}
RETRY_AFTER = {"Retry-After": header("Seconds to wait before the next request.", 1)}
LOCATION = {"Location": header("The job's URL.", "/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6")}
REPLAY = {REPLAYED: header("`true` if this repeats the response to the first request with this key.", "true")}
WAITED = {"Preference-Applied": header("The longest wait that `Prefer` requested and the server granted.", "wait=30")}


def json_body(model: str, example: dict[str, Any], *, required: bool = True) -> dict[str, Any]:
    """Return the OpenAPI description of a body that is a JSON document."""
    content = {"schema": {"$ref": _REFERENCE.format(model=model)}, "example": example}
    return {"requestBody": {"required": required, "content": {"application/json": content}}}


def bytes_body(description: str) -> dict[str, Any]:
    """Return the OpenAPI description of a body that is the bytes of a file."""
    return {"requestBody": {"required": True, "description": description, "content": BYTES}}


def form_body(
    model: str, files: Mapping[str, Any], form_examples: Mapping[str, Any], document: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the OpenAPI description of a body that is a form, or its document alone.

    `files`: the schemas of the form's files by name; `document`: what the media type of the document has beside its
    schema, such as `examples`.
    """
    schema = {"$ref": _REFERENCE.format(model=model)}
    form = {
        "schema": {
            "type": "object",
            "required": ["request"],
            "additionalProperties": False,
            "properties": {**files, "request": schema},
        },
        "encoding": {
            **{name: {"contentType": "application/octet-stream"} for name in files},
            "request": {"contentType": "application/json"},
        },
        "examples": form_examples,
    }
    content = {"multipart/form-data": form, "application/json": {"schema": schema, **document}}
    return {"requestBody": {"required": True, "content": content}}


def describe(app: FastAPI) -> None:
    """Make `app.openapi()` return the complete document."""
    generate = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = generate()
            others = [model for kind, model in PARAMS_OF_KIND.items() if kind != JobKind.TEXT_DEFORM]
            bring = kind_modules("routes")
            models: list[type[BaseModel]] = [*_MODELS, *(model for each in bring for model in each.MODELS), *others]
            _, more = models_json_schema([(model, "validation") for model in models], ref_template=_REFERENCE)
            schemas = document.setdefault("components", {}).setdefault("schemas", {})
            # FastAPI adds its own error schemas to every route with parameters; no response uses them.
            for name in ("HTTPValidationError", "ValidationError"):
                schemas.pop(name, None)
            schemas.update(more["$defs"])
            _allow_params(schemas, [model.__name__ for model in others])
            document["components"]["schemas"] = dict(sorted(schemas.items()))
            document["servers"] = _SERVERS
            document["tags"] = [*_TAGS, *(tag for each in bring for tag in each.TAGS)]
            _remove_null(document)
            document["info"]["description"] = _DESCRIPTION
            document["info"]["license"] = {"name": "Apache-2.0", "identifier": "Apache-2.0"}
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _allow_params(schemas: dict[str, Any], models: list[str]) -> None:
    """Let `params` be those of any kind of job: by their types in Python they would be those of `text_deform`."""
    deform = {_REFERENCE.format(model=name) for name in ("DeformParams", "ResolvedParams")}
    further = [{"$ref": _REFERENCE.format(model=name)} for name in models]
    for schema in schemas.values():
        params = schema.get("properties", {}).get("params", {})
        if params.get("$ref") in deform:
            params["anyOf"] = [{"$ref": params.pop("$ref")}, *further]


def _remove_null(document: dict[str, Any]) -> None:
    """Remove `null` from the schemas of parameters: it is Python's default, and cannot be sent."""
    for methods in document["paths"].values():
        for operation in methods.values():
            for parameter in operation.get("parameters", []):
                schema = parameter["schema"]
                kinds = [kind for kind in schema.get("anyOf", []) if kind != {"type": "null"}]
                if len(kinds) == 1 and "$ref" not in kinds[0]:
                    parameter["schema"] = {**{k: v for k, v in schema.items() if k != "anyOf"}, **kinds[0]}
                elif kinds:
                    # Some readers ignore the siblings of a reference.
                    schema["anyOf"] = kinds
