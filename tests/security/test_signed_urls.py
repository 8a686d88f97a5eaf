"""Signed URLs open what they are signed for, and nothing besides."""

from __future__ import annotations

import httpx
import pytest
from starlette.datastructures import URL
from starlette.requests import Request

from tests.integration.conftest import Api
from tests.integration.http_calls import check_problem, finished_job, post


def test_a_signature_counts_for_the_path_that_is_served_whatever_the_host_header_makes_of_it(
    api: Api, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine, theirs = (api.http.post("/v1/uploads", json={"filename": "a.glb", "size": 3}).json() for _ in range(2))
    # Starlette before 1.0 put the Host header into the URL, where it could bring a path along.
    path, _, query = mine["url"].partition("?")
    monkeypatch.setattr(Request, "url", property(lambda _: URL(f"http://127.0.0.1{path}?{query}")))
    forged = httpx.put(f"{api.url}/v1/uploads/{theirs['id']}/content?{query}", content=b"abc")
    assert (forged.status_code, forged.json()["code"]) == (403, "forbidden")
    assert api.http.get(f"/v1/uploads/{theirs['id']}").json()["offset"] == 0


def test_only_a_valid_signature_lets_pages_of_other_origins_read(api: Api, sphere: bytes) -> None:
    job_id = post(api, sphere).json()["id"]
    header = "access-control-allow-origin"
    answer = api.http.get(f"/v1/jobs/{job_id}/asset", params={"signature": "x"})
    assert header not in answer.headers, "no URL is signed for it, so the key counts"
    # The refusal itself may be read: a page learns that its URL is no longer good.
    answer = api.http.get(f"/v1/jobs/{finished_job(api)}/artifacts/result.glb", params={"signature": "x"})
    check_problem(answer, 403, "forbidden")
    signed = api.http.post(f"/v1/jobs/{finished_job(api)}/artifacts/result.glb/url").json()["url"]
    assert httpx.get(f"{api.url}{signed}").headers[header] == "*"
