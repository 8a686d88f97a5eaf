"""The HTTP API as a whole, with a real Redis, SQLite and files on disk."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from meshdeform.client import Client
from tests.cases import each_case
from tests.integration.conftest import Api, new_job
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
    assert answer.headers["connection"] == "close"


def messages(problem: dict[str, Any]) -> dict[str, str]:
    return {".".join(map(str, error["loc"])): error["msg"] for error in problem["errors"]}


@each_case(
    "url, place, message",
    [
        ("/v1/jobs?stat=queued", "query.stat", "there is no such parameter. Did you mean 'state'?"),
        ("/v1/jobs?prompt=vase", "query.prompt", None),
        ("/v1/jobs?state=queued&metdata[shot]=1", "query.metdata[shot]", None),
        ("/v1/jobs/{id}?limit=3", "query.limit", "there is no such parameter. There are: none."),
        ("/v1/jobs/{id}/events?aftr=3", "query.aftr", "there is no such parameter. Did you mean 'after'?"),
        ("/v1/jobs/{id}/artifacts/result.glb?expire=3", "query.expire", None),
        ("/v1/limits?x=", "query.x", None),
        ("/v1/webhooks?x=1", "query.x", None),
        ("/v1/uploads/upl_01kg9zqk2xf3v8c5m7n9p1r4t6?x=1", "query.x", None),
    ],
)
def test_unknown_query_parameters_are_refused(url: str, place: str, message: str | None, api: Api) -> None:
    answer = api.http.get(url.replace("{id}", new_job(api.record).id))
    problem = check_problem(answer, 422, "parameter_invalid")
    assert list(messages(problem)) == [place]
    assert message is None or problem["detail"] == f"{place}: {message}"


@pytest.mark.both_databases
def test_jobs_created_after_a_time(api: Api) -> None:
    first, second = new_job(api.record), new_job(api.record)
    with Client(api.url) as client:
        assert [job.id for job in client.jobs(created_after=first.created_at)] == [second.id]
        assert list(client.jobs(created_after=datetime.now(UTC) + timedelta(hours=2))) == []
        early = [job.id for job in client.jobs(created_after=first.created_at - timedelta(milliseconds=1))]
        assert early[:2] == [second.id, first.id]
    for text in ("2026-01-31T12:00:00", "yesterday", ""):
        problem = check_problem(api.http.get("/v1/jobs", params={"created_after": text}), 422, "parameter_invalid")
        assert "query.created_after" in messages(problem)
    assert api.http.get("/v1/jobs", params={"created_after": "0001-01-01T00:00:00Z", "limit": 1}).json()["jobs"]
    assert api.http.get("/v1/jobs", params={"created_after": "9999-12-31T23:59:59Z"}).json()["jobs"] == []
