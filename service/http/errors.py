"""Every error as `application/problem+json`: one handler renders them, one function documents them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.routing import Match

from meshdeform.errors import (
    IdempotencyBusyError,
    JobNotFinishedError,
    LimitError,
    MeshdeformError,
    MethodNotAllowedError,
    NotFoundError,
    ParameterError,
    RangeError,
    RequestError,
    UnauthorizedError,
    UnavailableError,
)
from service.http.middleware import request_id

__all__ = ["PROBLEM_TYPE", "add_error_handlers", "parameter_error", "problem_responses"]

PROBLEM_TYPE = "application/problem+json"
_METHODS = ("DELETE", "GET", "HEAD", "PATCH", "POST", "PUT")
_BUSY_S = 5  # when to come again where nobody knows when there will be room
_log = logging.getLogger(__name__)


def add_error_handlers(app: FastAPI) -> None:
    """Answer every error with a problem document."""
    app.add_exception_handler(MeshdeformError, _on_ours)
    app.add_exception_handler(RequestValidationError, _on_validation)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(Exception, _on_unknown)


def parameter_error(errors: Sequence[Any]) -> ParameterError:
    """Return pydantic's findings as our error: what and where, but not the input, which may be long or secret."""
    found = [{"loc": list(error["loc"]), "msg": _message(error), "type": error["type"]} for error in errors]
    first = found[0]
    place = ".".join(str(part) for part in first["loc"])
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return ParameterError(f"{place}: {first['msg']}{more}" if place else f"{first['msg']}{more}", errors=found)


def _message(error: Any) -> str:
    return "there is no such member." if error["msg"].startswith("Extra inputs") else str(error["msg"])


def problem_responses(*errors: type[MeshdeformError]) -> dict[int | str, dict[str, Any]]:
    """Return what OpenAPI says about the errors of a route, by status, each code with an example."""
    responses: dict[int | str, dict[str, Any]] = {}
    for error in errors:
        title = (error.__doc__ or "").strip().splitlines()[0]
        response = responses.setdefault(error.status, {"description": "", "content": _content()})
        response["description"] = " ".join(filter(None, [response["description"], f"`{error.code}`: {title}"]))
        example = _document(error(title), "/v1/jobs")
        response["content"][PROBLEM_TYPE]["examples"][error.code] = {"summary": title, "value": example}
    return {**dict(sorted(responses.items())), "default": {"description": "Any other problem.", "content": _content()}}


def _content() -> dict[str, Any]:
    return {PROBLEM_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}, "examples": {}}}


def _document(error: MeshdeformError, path: str, status: int | None = None) -> dict[str, Any]:
    return {
        **error.extra,
        "type": f"urn:meshdeform:problem:{error.code}",
        "title": error.title,
        "status": status or error.status,
        "detail": error.detail,
        "code": error.code,
        "advice": error.advice_text,
        "instance": path,
        **({"request_id": identity} if (identity := request_id()) else {}),
    }


def _answer(
    request: Request, error: MeshdeformError, *, status: int | None = None, headers: dict[str, str] | None = None
) -> JSONResponse:
    headers = dict(headers or {})
    if isinstance(error, UnauthorizedError):
        headers["WWW-Authenticate"] = "Bearer"
    if isinstance(error, UnavailableError):
        headers["Retry-After"] = "2"
    if isinstance(error, IdempotencyBusyError | JobNotFinishedError):
        headers["Retry-After"] = "1"
    if isinstance(error, LimitError):
        headers["Retry-After"] = str(error.extra.get("retry_after_s", _BUSY_S))
    if isinstance(error, RangeError):
        headers["Content-Range"] = f"bytes */{error.extra['size']}"
    document = _document(error, request.url.path, status)
    if request.method in ("PATCH", "POST", "PUT") and document["status"] in (408, 413):
        # The rest of the body is not read: the connection cannot carry another request.
        headers["Connection"] = "close"
    return JSONResponse(document, document["status"], headers, PROBLEM_TYPE)


async def _on_ours(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, MeshdeformError)
    if error.status >= 500:
        _log.error("%s %s: %s", request.method, request.url.path, error.detail, exc_info=error)
    return _answer(request, error)


async def _on_validation(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    findings = error.errors()
    if any(finding["loc"][0] == "path" for finding in findings):
        # An id that cannot be one names nothing.
        return _answer(request, NotFoundError(f"There is nothing at {request.url.path}."))
    return _answer(request, parameter_error(findings))


async def _on_http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    if isinstance(error.__cause__, MeshdeformError):
        # FastAPI's words for whatever went wrong while it read a body; ours are better.
        return _answer(request, error.__cause__)
    headers = dict(error.headers or {})
    if error.status_code == 404:
        advice = "The routes are in /openapi.json."
        return _answer(request, NotFoundError(f"There is no route {request.url.path}.", advice=advice), headers=headers)
    if error.status_code == 405:
        problem = MethodNotAllowedError(f"{request.url.path} does not know {request.method}.")
        return _answer(request, problem, headers={"Allow": ", ".join(_allowed_methods(request))})
    known = RequestError if error.status_code < 500 else MeshdeformError
    return _answer(request, known(str(error.detail)), status=error.status_code, headers=headers)


def _allowed_methods(request: Request) -> list[str]:
    """Every method that the path knows. Starlette would name those of one route, and each of ours knows one method."""
    scopes = {method: {**request.scope, "method": method} for method in _METHODS}
    return [
        method
        for method, scope in scopes.items()
        if any(route.matches(scope)[0] is Match.FULL for route in request.app.routes)
    ]


async def _on_unknown(request: Request, error: Exception) -> JSONResponse:
    # Starlette logs the traceback. What the error says may hold paths or values of the server: it stays there.
    del error
    problem = MeshdeformError("The server met an error that it does not know.", advice="Its log says more.")
    return _answer(request, problem)
