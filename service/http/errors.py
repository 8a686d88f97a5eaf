"""Render errors as `application/problem+json`, in plain words, and describe them for OpenAPI."""

from __future__ import annotations

import errno
import logging
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from fastapi import Depends, FastAPI, Request
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from pydantic import BaseModel
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
from meshdeform.requests.problems import did_you_mean, reason
from service.http.middleware import request_id

PROBLEM_TYPE = "application/problem+json"

_METHODS = ("DELETE", "GET", "HEAD", "PATCH", "POST", "PUT")

_BUSY_S = 5  # Retry-After where the wait cannot be computed

_log = logging.getLogger(__name__)


_SHOWN = 64


def add_error_handlers(app: FastAPI) -> None:
    """Answer every error with a problem document."""
    app.add_exception_handler(MeshdeformError, _on_ours)
    app.add_exception_handler(RequestValidationError, _on_validation)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(OSError, _on_system)
    app.add_exception_handler(Exception, _on_unknown)


def parameter_error(errors: Sequence[Any]) -> ParameterError:
    """Convert pydantic's errors to a ParameterError, without the input, which may be long or secret."""
    problems = [{"loc": list(error["loc"]), "msg": reason(error), "type": error["type"]} for error in errors]
    first = problems[0]
    location = ".".join(str(step) for step in first["loc"])
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return ParameterError(f"{location}: {first['msg']}{more}" if location else f"{first['msg']}{more}", errors=problems)


def problem_responses(*errors: type[MeshdeformError]) -> dict[int | str, dict[str, Any]]:
    """Return OpenAPI's response objects for the errors of a route, by status, with an example for each code."""
    responses: dict[int | str, dict[str, Any]] = {}
    for error in errors:
        title = (error.__doc__ or "").strip().splitlines()[0]
        response = responses.setdefault(error.status, {"description": "", "content": _content()})
        response["description"] = " ".join(filter(None, [response["description"], f"`{error.code}`: {title}"]))
        example = _document(error(title), "/v1/jobs")
        response["content"][PROBLEM_TYPE]["examples"][error.code] = {"summary": title, "value": example}
    return {**dict(sorted(responses.items())), "default": {"description": "Any other error.", "content": _content()}}


def answers(
    model: type[BaseModel] | None,
    description: str,
    *errors: type[MeshdeformError],
    status: int = 200,
    headers: Mapping[str, Any] | None = None,
) -> dict[int | str, dict[str, Any]]:
    """Return the response objects of a route for OpenAPI: that of success, maybe with a document, and its errors."""
    success: dict[str, Any] = {"description": description}
    success |= {"model": model} if model is not None else {}
    success |= {"headers": headers} if headers is not None else {}
    return {status: success, **problem_responses(*errors)}


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
        headers["Retry-After"] = str(error.extra.get("retry_after_s", 1))
    if isinstance(error, LimitError):
        headers["Retry-After"] = str(error.extra.get("retry_after_s", _BUSY_S))
    if isinstance(error, RangeError):
        headers["Content-Range"] = f"bytes */{error.extra['size']}"
    document = _document(error, request.url.path, status)
    if request.method in ("PATCH", "POST", "PUT") and document["status"] in (408, 413):
        # The rest of the body is not read, so that the connection cannot be reused.
        headers["Connection"] = "close"
    return JSONResponse(document, document["status"], headers, PROBLEM_TYPE)


async def _on_ours(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, MeshdeformError)
    if isinstance(error, UnavailableError):
        _log.warning("%s %s: %s", request.method, request.url.path, error.detail)
    elif error.status >= 500:
        _log.error("%s %s: %s", request.method, request.url.path, error.detail, exc_info=error)
    return _answer(request, error)


async def _on_validation(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    findings = error.errors()
    if any(finding["loc"][0] == "path" for finding in findings):
        # A malformed id cannot exist.
        return _answer(request, NotFoundError(f"{request.url.path} does not exist."))
    return _answer(request, parameter_error(findings))


async def _on_http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    if isinstance(error.__cause__, MeshdeformError):
        # FastAPI wraps errors that occur while it reads a body; unwrap ours.
        return _answer(request, error.__cause__)
    headers = dict(error.headers or {})
    if error.status_code == 404:
        advice = "All routes are listed in /openapi.json."
        return _answer(request, NotFoundError(f"There is no route {request.url.path}.", advice=advice), headers=headers)
    if error.status_code == 405:
        problem = MethodNotAllowedError(f"{request.url.path} does not support {request.method}.")
        return _answer(request, problem, headers={"Allow": ", ".join(_allowed_methods(request))})
    known = RequestError if error.status_code < 500 else MeshdeformError
    return _answer(request, known(str(error.detail)), status=error.status_code, headers=headers)


def _allowed_methods(request: Request) -> list[str]:
    """Return every method of the path. Starlette would return those of one route, and each of ours has one method."""
    scopes = {method: {**request.scope, "method": method} for method in _METHODS}
    return [
        method
        for method, scope in scopes.items()
        if any(route.matches(scope)[0] is Match.FULL for route in request.app.routes)
    ]


async def _on_system(request: Request, error: Exception) -> JSONResponse:
    if not isinstance(error, OSError) or error.errno not in (errno.ENOSPC, errno.EDQUOT):
        raise error
    full = UnavailableError("The server has no room for a file that it receives.", advice="Try again in a few minutes.")
    _log.error("%s: no space left on the device of the temporary or the data folder", request.url.path)
    return _answer(request, full)


async def _on_unknown(request: Request, error: Exception) -> JSONResponse:
    # Starlette logs the traceback. The message may contain paths or secrets, so it is not sent.
    del error
    problem = MeshdeformError("An unexpected error occurred in the server.", advice="Its log has the details.")
    answer = _answer(request, problem)
    # The server ends the connection when the error reaches it, which would cut off a request that follows on it.
    answer.headers["Connection"] = "close"
    return answer


async def _known_query(request: Request) -> None:
    """Refuse an unknown query parameter, if the caller may ask at all, and name the one that was probably meant."""
    if not request.query_params or "signature" in request.query_params:
        return  # a signature covers the whole query, and opens nothing else
    known = set(_names(request.scope["route"]))
    errors = [
        {
            "loc": ["query", name[:_SHOWN]],
            "msg": did_you_mean(name[:_SHOWN], known, "parameter"),
            "type": "extra_forbidden",
        }
        for name in list(request.query_params)[:_SHOWN]
        if name.partition("[")[0] not in known
    ]
    if errors:
        await request.app.state.gate.admit(request)  # without a key, say nothing but that one is needed
        raise parameter_error(errors)


def _names(route: APIRoute) -> Iterator[str]:
    """Yield the names of a route's query parameters."""
    todo: list[Dependant] = [route.dependant]
    while todo:
        dependant = todo.pop()
        yield from (parameter.alias for parameter in dependant.query_params)
        todo += dependant.dependencies
    for parameter in (route.openapi_extra or {}).get("parameters", []):
        if parameter["in"] == "query":
            yield parameter["name"]


KNOWN_QUERY = [Depends(_known_query)]
"""The dependencies of every router under `/v1`."""
