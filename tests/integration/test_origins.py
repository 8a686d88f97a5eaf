"""Web pages of other origins: preflights, readable answers and signed URLs; and HEAD wherever GET is."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import httpx
import pytest

from meshdeform.errors import ParameterError
from meshdeform.record.repository import JobRecord
from meshdeform.serving.access import check_origins
from meshdeform.settings import Settings
from service.http.origins import EXPOSED
from tests.cases import each_case
from tests.integration.conftest import Start, new_job

PAGE, OTHER = "https://app.example", "https://evil.example"
UPLOAD = {"filename": "a.glb", "size": 4}
ALLOWED = "access-control-allow-origin"


def preflight(http: httpx.Client, path: str, origin: str = PAGE, method: str = "POST") -> httpx.Response:
    asked = {"Access-Control-Request-Method": method, "Access-Control-Request-Headers": "authorization,prefer"}
    return http.options(path, headers={"Origin": origin, **asked})


@each_case("auth", ["on", "off"])
def test_a_listed_page_may_do_what_its_key_may_and_no_other_page_anything(
    start: Start, record: JobRecord, auth: str
) -> None:
    http = start(auth=auth, cors_origins=[PAGE])
    key = {"Authorization": f"Bearer {record.keys.create('ann')[1]}"}
    allowed = preflight(http, "/v1/jobs")
    assert allowed.status_code == 200
    assert allowed.headers[ALLOWED] == PAGE
    assert allowed.headers["access-control-allow-headers"].startswith("authorization")
    assert "access-control-allow-credentials" not in allowed.headers
    refused = preflight(http, "/v1/jobs", OTHER)
    assert (refused.status_code, ALLOWED in refused.headers) == (400, False)
    for path, status in {"/v1/jobs": 200, "/v1/jobs/none": 404, "/v1/jobs?none=1": 422, "/v1/nothing": 404}.items():
        answer = http.get(path, headers={"Origin": PAGE, **key})
        assert (answer.status_code, answer.headers[ALLOWED]) == (status, PAGE), path
        assert set(answer.headers["access-control-expose-headers"].split(", ")) == set(EXPOSED)
        assert "Origin" in answer.headers["vary"]
        assert ALLOWED not in http.get(path, headers={"Origin": OTHER, **key}).headers, path
    if auth == "on":  # that a key is missing can be read, too
        assert http.get("/v1/jobs", headers={"Origin": PAGE}).headers[ALLOWED] == PAGE
    else:
        assert http.get("/v1/jobs", headers={"Origin": PAGE}).status_code == 200
        assert http.get("/v1/jobs", headers={"Origin": OTHER}).status_code == 401


def test_nothing_is_said_by_default_and_every_page_only_where_keys_are_off(start: Start) -> None:
    assert preflight(start(auth="off"), "/v1/jobs").status_code == 405
    http = start(auth="off", cors_origins=["*"])
    assert preflight(http, "/v1/jobs", OTHER).headers[ALLOWED] == "*"
    assert http.get("/v1/jobs", headers={"Origin": OTHER}).headers[ALLOWED] == "*"
    # By a name that a page's host has taken on, it is refused as ever.
    assert http.get("/v1/jobs", headers={"Origin": OTHER, "Host": "evil.example"}).status_code == 401


@each_case(
    ("auth", "origins", "fits"),
    [("on", ["*"], False), ("auto", ["*"], False), ("off", ["*"], True), ("on", [PAGE], True)],
)
def test_every_page_is_refused_where_keys_are_on(auth: Any, origins: list[str], fits: bool) -> None:
    with nullcontext() if fits else pytest.raises(ParameterError, match="CORS_ORIGINS"):
        check_origins(Settings(auth=auth, cors_origins=origins))


@each_case("origin", ["app.example", "https://app.example/", "https://App.example", "https://a.example/b", "null", ""])
def test_what_is_no_origin_is_refused(origin: str) -> None:
    with pytest.raises(ValueError, match="is not an origin"):
        Settings(cors_origins=[origin])


def test_a_signed_url_is_open_to_every_page_and_opens_nothing_else(start: Start, record: JobRecord) -> None:
    http = start(auth="on")
    key = {"Authorization": f"Bearer {record.keys.create('ann')[1]}"}
    upload = http.post("/v1/uploads", headers=key, json=UPLOAD).json()
    assert preflight(http, upload["url"], OTHER, "PUT").headers[ALLOWED] == "*"
    sent = http.put(upload["url"], content=b"glTF", headers={"Origin": OTHER, **upload["headers"]})
    assert (sent.status_code, sent.headers[ALLOWED]) == (204, "*")
    assert "Upload-Offset" in sent.headers["access-control-expose-headers"]
    assert http.head(upload["url"], headers={"Origin": OTHER}).headers["upload-offset"] == "4"
    job = new_job(record)
    artifact = f"/v1/jobs/{job.id}/artifacts/result.glb"
    assert preflight(http, f"{artifact}?expires=1&signature=ab", OTHER, "GET").headers[ALLOWED] == "*"
    wrong = http.get(f"{artifact}?expires=1&signature=ab", headers={"Origin": OTHER})
    assert (wrong.status_code, wrong.headers[ALLOWED]) == (403, "*"), "why it is refused can be read"
    for path, method in ((f"{artifact}?signature=ab", "POST"), ("/v1/jobs?signature=ab", "GET"), (artifact, "GET")):
        assert ALLOWED not in preflight(http, path, OTHER, method).headers, path
        assert ALLOWED not in http.request(method, path, headers={"Origin": OTHER, **key}).headers, path


def test_head_is_get_without_its_body(start: Start, record: JobRecord, openapi: dict[str, Any]) -> None:
    http = start(auth="off")
    job = new_job(record)
    for path in ("/v1/jobs", f"/v1/jobs/{job.id}", "/v1/limits", "/healthz", "/openapi.json", "/v1/jobs/none"):
        got, head = http.get(path), http.head(path)
        assert (head.status_code, head.content) == (got.status_code, b""), path
        same = {"content-type", "content-length", "etag"} & got.headers.keys()
        assert {name: head.headers[name] for name in same} == {name: got.headers[name] for name in same}, path
    assert http.head(f"/v1/jobs/{job.id}/events").status_code == 405  # a stream ends with its job
    assert http.head("/v1/jobs:validate").status_code == 405
    said = {
        name
        for operations in openapi["paths"].values()
        for operation in operations.values()
        for answer in operation["responses"].values()
        for name in answer.get("headers", {})
    }
    assert said <= set(EXPOSED)
