"""Convert error responses and failed connections to the errors of `meshdeform.errors`.

::

    MeshdeformError            every code of the service has its class, see meshdeform.errors
    ├── UnavailableError       503, 502, 504, no connection, a broken connection, wrong bytes
    ├── LimitError             429; retry_after_s is the delay before the next try
    ├── ...
    └── WaitTimeoutError       the caller's own timeout has passed; also a TimeoutError
"""

from __future__ import annotations

import email.utils
import json
import time
from typing import Any

import httpx

from meshdeform.api.states import JobState
from meshdeform.client.documents import JobView
from meshdeform.client.requests import Answer
from meshdeform.errors import (
    AssetFormatError,
    AssetTooLargeError,
    ConflictError,
    ForbiddenError,
    LimitError,
    MeshdeformError,
    MethodNotAllowedError,
    NotFoundError,
    RangeError,
    RequestError,
    RequestTimeoutError,
    UnauthorizedError,
    UnavailableError,
)

_PROBLEM_MEMBERS = frozenset({"type", "title", "status", "detail", "code", "advice", "instance", "request_id"})
_BY_STATUS: dict[int, type[MeshdeformError]] = {
    401: UnauthorizedError,
    403: ForbiddenError,
    404: NotFoundError,
    405: MethodNotAllowedError,
    408: RequestTimeoutError,
    409: ConflictError,
    410: NotFoundError,
    413: AssetTooLargeError,
    415: AssetFormatError,
    416: RangeError,
    429: LimitError,
    502: UnavailableError,
    503: UnavailableError,
    504: UnavailableError,
}


class WaitTimeoutError(MeshdeformError, TimeoutError):
    """The awaited job has not finished in time, but it continues."""

    status = 504
    code = "wait_timeout"
    advice = "Wait again with the job's id, give it more time, or cancel it."


def class_of(code: str, status: int) -> type[MeshdeformError]:
    """Return the class of a code, or for an unknown code the closest class for its status."""
    todo: list[type[MeshdeformError]] = [MeshdeformError]
    while todo:
        kind = todo.pop()
        if kind.code == code:
            return kind
        todo += kind.__subclasses__()
    if status in _BY_STATUS:
        return _BY_STATUS[status]
    return RequestError if 400 <= status < 500 else MeshdeformError


def error_of(answer: Answer) -> MeshdeformError:
    """Return the error of a problem document, or a general error for other responses, for example from a proxy."""
    try:
        problem = json.loads(answer.content)
        code, detail, advice = str(problem["code"]), str(problem["detail"]), str(problem["advice"])
    except (ValueError, KeyError, TypeError):
        return _foreign_error(answer)
    extra = {key: value for key, value in problem.items() if key not in _PROBLEM_MEMBERS}
    error = _made(code, answer.status, detail, advice, extra)
    error.request_id = problem.get("request_id") or answer.headers.get("x-request-id")
    error.retry_after_s = retry_after_s(answer)
    return error


def succeeded(job: JobView) -> JobView:
    """Return the job if it succeeded."""
    if job.state is JobState.SUCCEEDED:
        return job
    if job.error is not None:
        raise _made(job.error.code, job.error.status, job.error.detail, job.error.advice, {"job_id": job.id})
    raise ConflictError(f"The job {job.id} is {job.state}.", advice="Post it again, or retry it.", job_id=job.id)


def unreachable(error: httpx.HTTPError, url: str) -> UnavailableError:
    """Return the error for a request without a response."""
    words = str(error) or "no answer in time" if isinstance(error, httpx.TimeoutException) else str(error)
    reason = f"{type(error).__name__}: {words}" if words else type(error).__name__
    return UnavailableError(
        f"{_address(error, url)} does not respond ({reason}).",
        advice="Check the service's address, and that it is running; `meshdeform serve` starts one on this machine.",
    )


def _address(error: httpx.HTTPError, url: str) -> str:
    """Return host, port and path of a request, without secrets: a query may be signed, and a URL has a password."""
    try:
        address = error.request.url
    except RuntimeError:
        return url.partition("?")[0]
    # Not `netloc`, which leaves out the default port.
    host = f"[{address.host}]" if ":" in address.host else address.host
    port = address.port or {"http": 80, "https": 443}.get(address.scheme)
    return f"{address.scheme}://{host}:{port}{address.path}"


def retry_after_s(answer: Answer) -> float | None:
    """Return the seconds to wait according to `Retry-After`, or None if there is none."""
    value = answer.headers.get("retry-after", "").strip()
    if not value:
        return None
    try:
        seconds = float(value)
    except ValueError:
        try:
            seconds = email.utils.parsedate_to_datetime(value).timestamp() - time.time()
        except ValueError:
            return None
    return max(seconds, 0.0) if seconds == seconds and seconds != float("inf") else None


def _made(code: str, status: int, detail: str, advice: str, extra: dict[str, Any]) -> MeshdeformError:
    kind = class_of(code, status)
    # Set the members afterwards, so that they cannot collide with the constructor's arguments.
    error = kind(detail, advice=advice)
    error.extra = extra
    # The document's code, status and advice take precedence over those of the class.
    vars(error).update(code=code, status=status, advice=advice)
    return error


def _foreign_error(answer: Answer) -> MeshdeformError:
    kind = class_of("", answer.status)
    advice = "Check the service's address and any proxy in front of it."
    if "location" in answer.headers and 300 <= answer.status < 400:
        advice = f"It redirects to {answer.headers['location']}: use that address instead."
    error = kind(f"{answer.url} answered {answer.status}.", advice=advice)
    vars(error).update(status=answer.status, advice=advice)
    error.request_id = answer.headers.get("x-request-id")
    error.retry_after_s = retry_after_s(answer)
    return error
