"""Jobs that this version cannot read, over HTTP, in the Python client and on the command line."""

from __future__ import annotations

import warnings

import httpx

from tests.cases import each_case
from tests.integration.conftest import Api
from tests.integration.http_calls import check_problem, finished_job
from tests.integration.other_versions import LATER, accepted_elsewhere
from tests.integration.record_calls import posted, set_to


@each_case("new", LATER)
def test_they_are_listed_looked_at_canceled_and_deleted_and_not_retried(api: Api, new: str) -> None:
    document = LATER[new]
    job_id = accepted_elsewhere(api.record, document).id
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        listed = {job["id"]: job for job in api.http.get("/v1/jobs", params={"limit": 200}).json()["jobs"]}
        shown = api.http.get(f"/v1/jobs/{job_id}")
    assert listed[job_id] == shown.json()
    assert shown.json()["params"] == (document["params"] if isinstance(document["params"], dict) else {})
    assert "cannot be read here" in shown.json()["unreadable"]
    assert shown.headers["ETag"]
    assert api.http.get(f"/v1/jobs/{job_id}/events", headers={"Accept": "application/json"}).status_code == 200
    branch = api.http.post(f"/v1/jobs/{job_id}/checkpoints/1/branch", json={"prompt": "a vase"})
    check_problem(branch, 409, "job_unreadable")
    assert api.http.post(f"/v1/jobs/{job_id}/cancel").json()["state"] == "canceled"
    check_problem(api.http.post(f"/v1/jobs/{job_id}/retry"), 409, "job_unreadable")
    link = api.http.post(f"/v1/jobs/{job_id}/url").json()["url"]
    seen = api.http.get(f"/v1/jobs/{job_id}", params=dict(httpx.URL(link).params))
    assert "cannot be read here" in seen.json()["unreadable"], link
    assert api.http.delete(f"/v1/jobs/{job_id}").status_code == 204
    # Its results are downloaded as they are.
    job_id = finished_job(api, b"glTF and so on")
    kind = document.get("kind", "text_deform")
    files = {"files": {}} if kind == "image_deform" else {}
    set_to(api.record, api.record.get(job_id), request=document, kind=kind, **files)
    result = f"/v1/jobs/{job_id}/artifacts/result.glb"
    assert api.http.get(result).content == b"glTF and so on"
    check_problem(api.http.get(f"{result}?strength=0.5"), 409, "job_unreadable")
    check_problem(api.http.post(f"/v1/jobs/{job_id}/artifacts/morph.glb"), 404, "not_found")


ODD = ([], "text", 7, {"a": []}, [[{}]], {"mode": 3, "job_id": []}, {"kind": [], "params": {"params": None}})


@each_case("column", ["request", "resolved", "files", "origin", "error", "losses"])
def test_a_row_of_any_json_is_an_unreadable_job_and_no_error_of_the_server(api: Api, column: str) -> None:
    for value in ODD:
        job_id = set_to(api.record, posted(api.record), **{column: value}).id
        job = api.http.get(f"/v1/jobs/{job_id}").json()
        assert job["id"] == job_id
        assert job["unreadable"] or column in ("resolved", "error", "losses")
        listed = api.http.get("/v1/jobs", params={"limit": 200, "error": "unknown"})
        assert (listed.status_code, api.http.get("/v1/jobs").status_code) == (200, 200)
        events = api.http.get(f"/v1/jobs/{job_id}/events", headers={"Accept": "application/json"})
        assert events.json()["events"][0]["type"] == "queued"
        estimated = api.http.post(f"/v1/jobs/{job_id}/checkpoints/1/branch", json={"prompt": "a vase"})
        assert estimated.status_code < 500
        assert api.http.post(f"/v1/jobs/{job_id}/cancel").json()["state"] == "canceled"
        assert api.http.post(f"/v1/jobs/{job_id}/retry").status_code < 500
        assert api.http.delete(f"/v1/jobs/{job_id}").status_code == 204
    left = api.record.leases.claim_next("w", 60.0)
    assert left is None or left.request
