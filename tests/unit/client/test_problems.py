"""Every code of the service comes back as its class, and so does what nobody has heard of."""

from __future__ import annotations

import json
import pickle
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime

import httpx

import meshdeform
from meshdeform import errors
from meshdeform.client.problems import WaitTimeoutError, class_of, error_of, retry_after_s, unreachable
from meshdeform.client.requests import Answer
from meshdeform.errors import MeshdeformError, UnavailableError
from tests.cases import each_case
from tests.unit.client.worlds import answer

KINDS = sorted(
    {value for value in vars(errors).values() if isinstance(value, type) and issubclass(value, MeshdeformError)},
    key=lambda kind: kind.code,
)


def problem(code: str, status: int, **more: object) -> Answer:
    document = {"type": "urn:x", "title": "t", "code": code, "detail": "d", "advice": "a", "status": status, **more}
    return answer(status, json.dumps(document), retry_after="7", x_request_id="req_header")


@each_case("kind", KINDS, ids=lambda kind: kind.code)
def test_every_code_has_its_class(kind: type[MeshdeformError]) -> None:
    error = error_of(problem(kind.code, kind.status, request_id="req_1", more=1, detail_of="x"))
    assert type(error) is kind
    assert (error.code, error.status, error.detail, error.advice) == (kind.code, kind.status, "d", "a")
    assert (error.request_id, error.retry_after_s, str(error)) == ("req_1", 7.0, "d")
    assert error.extra == {"more": 1, "detail_of": "x"}
    assert error.title == kind("d").title


@each_case("kind", KINDS, ids=lambda kind: kind.code)
def test_every_class_is_a_name_of_the_package(kind: type[MeshdeformError]) -> None:
    assert getattr(meshdeform, kind.__name__) is kind
    assert kind.__name__ in dir(meshdeform)


@each_case(
    ("status", "expected"),
    [
        (400, errors.RequestError),
        (401, errors.UnauthorizedError),
        (403, errors.ForbiddenError),
        (404, errors.NotFoundError),
        (405, errors.MethodNotAllowedError),
        (408, errors.RequestTimeoutError),
        (409, errors.ConflictError),
        (413, errors.AssetTooLargeError),
        (415, errors.AssetFormatError),
        (416, errors.RangeError),
        (418, errors.RequestError),
        (422, errors.RequestError),
        (429, errors.LimitError),
        (500, MeshdeformError),
        (501, MeshdeformError),
        (502, UnavailableError),
        (503, UnavailableError),
        (504, UnavailableError),
    ],
)
def test_an_unknown_code_is_of_the_class_nearest_to_its_status(status: int, expected: type[MeshdeformError]) -> None:
    error = error_of(problem("quota_of_2031", status))
    assert type(error) is expected
    assert (error.code, error.status, error.advice) == ("quota_of_2031", status, "a")
    # A proxy's page.
    page = error_of(answer(status, "<html>", retry_after="3"))
    assert type(page) is expected
    assert (page.status, page.retry_after_s) == (status, 3.0)
    assert str(status) in page.detail


def test_the_class_itself_stays_as_it_is() -> None:
    before = (MeshdeformError.code, MeshdeformError.status, MeshdeformError.advice)
    error_of(problem("another", 555))
    assert (MeshdeformError.code, MeshdeformError.status, MeshdeformError.advice) == before


def test_a_redirect_says_where_to_go() -> None:
    assert "https://y/" in error_of(answer(301, location="https://y/")).advice


@each_case("content", ["[]", "null", '"x"', '{"code": "conflict"}', "{"])
def test_what_is_no_problem_document_is_no_trap(content: str) -> None:
    assert type(error_of(answer(409, content))) is errors.ConflictError


def test_time_is_up_is_in_the_tree_and_a_timeout_error() -> None:
    error = WaitTimeoutError("The job is not over.", job_id="job_1")
    assert isinstance(error, MeshdeformError)
    assert isinstance(error, TimeoutError)
    assert (error.code, error.extra, str(error)) == ("wait_timeout", {"job_id": "job_1"}, "The job is not over.")
    assert class_of("wait_timeout", 504) is WaitTimeoutError


def test_retry_after_is_read_in_both_of_its_forms() -> None:
    assert retry_after_s(answer(retry_after="1.5")) == 1.5
    assert retry_after_s(answer(retry_after="-3")) == 0.0
    soon = format_datetime(datetime.now(UTC) + timedelta(seconds=100), usegmt=True)
    found = retry_after_s(answer(retry_after=soon))
    assert found is not None
    assert 90 < found <= 100
    for text in ("", "soon", "nan", "inf", "Sat, 99 Jan"):
        assert retry_after_s(answer(retry_after=text)) is None


def test_no_answer_is_unavailable_and_says_why() -> None:
    for failure in (httpx.ConnectError("refused"), httpx.ReadTimeout(""), httpx.RemoteProtocolError("cut")):
        error = unreachable(failure, "https://bucket/there?signature=1")
        assert type(error) is UnavailableError
        assert "signature" not in error.detail
        assert type(failure).__name__ in error.detail


def test_a_service_that_does_not_respond_is_named_with_host_and_port_and_without_secrets() -> None:
    request = httpx.Request("GET", "http://me:secret@localhost/v1/jobs?signature=1")
    error = unreachable(httpx.ConnectError("refused", request=request), "/v1/jobs?signature=1")
    assert error.detail == "http://localhost:80/v1/jobs does not respond (ConnectError: refused)."
    assert "meshdeform serve" in error.advice_text


def test_errors_survive_a_pickle() -> None:
    error = error_of(problem("quota_of_2031", 429))
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), again.code, again.detail, again.retry_after_s) == (type(error), "quota_of_2031", "d", 7.0)
