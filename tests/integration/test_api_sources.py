"""Jobs whose files the service has by now, and jobs that are only tried out."""

from __future__ import annotations

import json
from typing import Any

import pytest

from meshdeform.record.models import JobState
from tests.cases import each_case
from tests.claims import claim_job
from tests.integration.conftest import Api, new_job
from tests.integration.http_calls import PROMPT, check_document, check_problem, finished_job, post
from tests.integration.record_calls import set_to

NO_UPLOAD = "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"
NO_JOB = "job_01kg9zqk2xf3v8c5m7n9p1r4t6"


def test_a_result_is_the_asset_of_another_job(api: Api, sphere: bytes, openapi: dict[str, Any]) -> None:
    first = finished_job(api, sphere)
    answer = api.http.post("/v1/jobs", json={**PROMPT, "asset": {"job_id": first}})
    assert answer.status_code == 202, answer.text
    check_document(answer.json(), "JobView", openapi)
    assert answer.json()["asset"]["filename"] == "result.glb"
    assert api.http.delete(f"/v1/jobs/{first}").status_code == 204
    assert api.store.get(api.record.get(answer.json()["id"]).files["asset"].key) == sphere


@each_case(
    ("asset", "loc"),
    [
        (None, ["asset"]),
        ({}, ["asset"]),
        ({"upload_id": NO_UPLOAD, "job_id": NO_JOB}, ["asset"]),
        ({"upload_id": NO_UPLOAD, "artifact": "a.glb"}, ["asset"]),
        ({"upload_id": "nonsense"}, ["asset", "upload_id"]),
        ({"job_id": NO_JOB, "artifact": "../x"}, ["asset", "artifact"]),
        ({"upload_id": NO_UPLOAD}, ["asset", "upload_id"]),
        ({"job_id": NO_JOB}, ["asset", "job_id"]),
    ],
)
def test_a_source_that_is_none_says_where(api: Api, asset: Any, loc: list[str]) -> None:
    document = PROMPT if asset is None else {**PROMPT, "asset": asset}
    for path in ("/v1/jobs", "/v1/jobs:validate"):
        problem = check_problem(api.http.post(path, json=document), 422, "parameter_invalid")
        assert problem["errors"][0]["loc"] == loc


def test_a_job_without_such_an_artifact_says_which_it_has(api: Api, sphere: bytes) -> None:
    document = {**PROMPT, "asset": {"job_id": finished_job(api, sphere), "artifact": "morph.glb"}}
    problem = check_problem(api.http.post("/v1/jobs", json=document), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["asset", "artifact"]
    document = {**PROMPT, "asset": {"job_id": new_job(api.record).id}}
    check_problem(api.http.post("/v1/jobs", json=document), 409, "conflict")


def test_what_a_reference_names_is_checked_like_what_is_sent(api: Api) -> None:
    document = {**PROMPT, "asset": {"job_id": finished_job(api, b"no mesh at all")}}
    before = api.record.list_jobs(limit=1).jobs
    check_problem(api.http.post("/v1/jobs", json=document), 415, "asset_format")
    assert api.record.list_jobs(limit=1).jobs == before


def test_a_job_is_tried_out_and_nothing_is_left(api: Api, sphere: bytes, openapi: dict[str, Any]) -> None:
    before = api.record.list_jobs(limit=1).jobs
    keys = set(api.store.list())
    request = {**PROMPT, "params": {"preset": "preview", "seed": 3}}
    files = {"asset": ("s.glb", sphere), "request": (None, json.dumps(request))}
    answer = api.http.post("/v1/jobs:validate", files=files)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    check_document(found, "Validation", openapi)
    assert found["valid"] is True
    assert (found["asset"]["format"], found["asset"]["triangles"]) == ("glb", 5120)
    assert (found["params"]["steps"], found["params"]["seed"]) == (60, 3)
    assert found["target"] is None
    assert api.record.list_jobs(limit=1).jobs == before
    assert set(api.store.list()) == keys
    files["request"] = (None, json.dumps({**request, "prompt": ""}))
    check_problem(api.http.post("/v1/jobs:validate", files=files), 422, "prompt_invalid")
    files = {"asset": ("s.glb", sphere[:-4]), "request": (None, json.dumps(request))}
    check_problem(api.http.post("/v1/jobs:validate", files=files), 422, "asset_truncated")


def test_the_estimate_goes_by_jobs_that_were_measured(api: Api, sphere: bytes) -> None:
    request = {**PROMPT, "params": {"preset": "preview"}}
    job = api.record.get(post(api, sphere, request).json()["id"])
    assert (job.faces, job.meshes) == (5120, 1)
    claim_job(api.record.leases, job.id, "worker", 60.0)
    api.record.leases.finish(job.id, 1, JobState.SUCCEEDED, step_s=0.5)
    set_to(api.record, job, ran_s=80 * 0.5 + 9.0, total_steps=80)
    for steps in (80, 10):
        document = json.dumps({**request, "params": {**request["params"], "steps": steps}})
        files = {"asset": ("s.glb", sphere), "request": (None, document)}
        found = api.http.post("/v1/jobs:validate", files=files).json()["estimate"]
        assert found["basis"].startswith("1 job of this kind and model")
        assert (found["steps"], found["run_s"]) == (steps, pytest.approx(9.0 + 0.5 * steps))
