"""The HTTP API as a whole, with a real Redis, SQLite and files on disk."""

from __future__ import annotations

from typing import Any

import pytest

from tests.integration.conftest import Api
from tests.integration.http_calls import check_document, check_problem


def test_a_route_or_method_that_is_not_there_is_a_problem(api: Api) -> None:
    check_problem(api.http.get("/v2/jobs"), 404, "not_found")
    check_problem(api.http.get("/v1/jobs/"), 404, "not_found")
    answer = api.http.put("/v1/jobs")
    check_problem(answer, 405, "method_not_allowed")
    assert answer.headers["allow"] == "GET, POST"
    assert api.http.put("/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6").headers["allow"] == "DELETE, GET"


def test_health_and_readiness(api: Api, openapi: dict[str, Any]) -> None:
    health = api.http.get("/healthz")
    assert health.status_code == 200
    check_document(health.json(), "Health", openapi)
    ready = api.http.get("/readyz")
    check_document(ready.json(), "Readiness", openapi)
    assert ready.status_code == 200
    assert {part["status"] for name, part in ready.json().items() if name != "status"} == {"ok"}


def test_a_mistake_of_ours_is_a_problem_without_its_details(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    def mistake(*_: object) -> None:
        raise RuntimeError("the password is 1234")

    monkeypatch.setattr("meshdeform.record.repository.JobRecord.list_jobs", mistake)
    answer = api.http.get("/v1/jobs")
    check_problem(answer, 500, "internal")
    assert "1234" not in answer.text
