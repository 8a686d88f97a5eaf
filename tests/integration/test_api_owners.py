"""Two owners share a server and never meet."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import replace

import httpx
import pytest
from fastapi import FastAPI, Request

from meshdeform.record.models import JobState, NewJob
from meshdeform.requests.document import JobRequest
from meshdeform.settings import Settings
from service.app import create_app
from service.http.auth import Principal, principal
from tests.integration import conftest
from tests.integration.conftest import Api, stored_file
from tests.integration.http_calls import PROMPT, check_problem, finished_job


def named(request: Request) -> Principal:
    """Who the header says: these tests are about what follows from it."""
    return Principal(owner_id=request.headers["x-owner"], max_active_jobs=int(request.headers.get("x-jobs", "0")))


async def named_too(request: Request, _: object) -> Principal:
    """The same, for what a link to a job opens as well."""
    return named(request)


@pytest.fixture(scope="module")
def two(own_settings: Callable[..., Settings]) -> Iterator[tuple[Api, Api]]:
    """The same server, as two owners see it."""

    def application(settings: Settings) -> FastAPI:
        app = create_app(settings)
        app.dependency_overrides[principal] = named
        return app

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conftest, "create_app", application)
        patch.setattr("service.http.links.principal", named_too)
        with conftest.serving_api(own_settings(max_upload_bytes=2**20)) as ann:
            ann.http.headers["x-owner"] = "ann"
            with httpx.Client(base_url=ann.url, timeout=240, headers={"x-owner": "bob"}) as other:
                yield ann, replace(ann, http=other)


def test_every_route_of_a_job_knows_only_its_owner(two: tuple[Api, Api]) -> None:
    ann, bob = two
    job = finished_job(ann, b"result", "ann", checkpoint=5)
    failed = ann.record.create(NewJob(JobRequest(prompt="a vase"), {"asset": stored_file()}, owner_id="ann")).id
    for method, path in (
        ("GET", f"/v1/jobs/{job}"),
        ("GET", f"/v1/jobs/{job}/artifacts"),
        ("GET", f"/v1/jobs/{job}/artifacts/result.glb"),
        ("HEAD", f"/v1/jobs/{job}/artifacts/result.glb"),
        ("POST", f"/v1/jobs/{job}/artifacts/result.glb/url"),
        ("GET", f"/v1/jobs/{job}/events"),
        ("GET", f"/v1/jobs/{job}/checkpoints"),
        ("POST", f"/v1/jobs/{job}/checkpoints/5/branch"),
        ("POST", f"/v1/jobs/{failed}/cancel"),
        ("POST", f"/v1/jobs/{failed}/retry"),
        ("DELETE", f"/v1/jobs/{job}"),
    ):
        body = {"json": PROMPT} if path.endswith("branch") else {}
        assert bob.http.request(method, path, **body).status_code == 404, (method, path)
        assert bob.http.request(method, path, headers={"Prefer": "wait=1"}, **body).status_code == 404
    assert ann.record.get(failed).state is JobState.QUEUED
    assert ann.http.get(f"/v1/jobs/{job}/artifacts/result.glb").content == b"result"


def test_lists_and_labels_show_only_ones_own(two: tuple[Api, Api]) -> None:
    ann, bob = two
    job = finished_job(ann, owner_id="ann", metadata={"whose": "mine"})
    for query in ("", "?state=succeeded", "?metadata[whose]=mine"):
        assert job in [found["id"] for found in ann.http.get(f"/v1/jobs{query}").json()["jobs"]]
        assert bob.http.get(f"/v1/jobs{query}").json()["jobs"] == []


def test_nobody_elses_files_can_be_named(two: tuple[Api, Api], sphere: bytes) -> None:
    ann, bob = two
    upload = ann.http.post("/v1/uploads", json={"filename": "a.glb", "size": len(sphere)}).json()
    # The signature is the permission, not the owner.
    assert bob.http.put(upload["url"], content=sphere).status_code == 204
    done = {"sha256": hashlib.sha256(sphere).hexdigest()}
    path = f"/v1/uploads/{upload['id']}"
    for method, where, body in (("GET", path, None), ("DELETE", path, None), ("POST", f"{path}/complete", done)):
        check_problem(bob.http.request(method, where, json=body), 404, "not_found")
    assert ann.http.post(f"{path}/complete", json=done).status_code == 200
    job = finished_job(ann, sphere, "ann")
    for asset in ({"upload_id": upload["id"]}, {"job_id": job}):
        document = {**PROMPT, "asset": asset}
        check_problem(bob.http.post("/v1/jobs", json=document), 422, "parameter_invalid")
        check_problem(bob.http.post("/v1/jobs:validate", json=document), 422, "parameter_invalid")
        answer = ann.http.post("/v1/jobs", json=document)
        assert answer.status_code == 202, answer.text
        assert ann.record.get(answer.json()["id"]).owner_id == "ann"


def test_one_key_of_two_owners_is_two_keys(two: tuple[Api, Api], sphere: bytes) -> None:
    def posted(api: Api, prompt: str) -> httpx.Response:
        files = {"asset": ("s.glb", sphere), "request": (None, json.dumps({"prompt": prompt}))}
        return api.http.post("/v1/jobs", files=files, headers={"Idempotency-Key": "same"})

    first, second = posted(two[0], "a vase"), posted(two[1], "a mushroom")
    assert (first.status_code, second.status_code) == (202, 202)
    assert first.json()["id"] != second.json()["id"]
