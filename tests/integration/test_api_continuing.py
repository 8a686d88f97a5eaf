"""Retries and branches: new jobs that begin with a checkpoint of another one."""

from __future__ import annotations

from typing import Any

import pytest

from meshdeform.assets import build_glb
from meshdeform.client import Client
from meshdeform.errors import PromptError, UnavailableError
from meshdeform.geometry.shapes import icosphere
from meshdeform.record.models import Job, JobError, JobState, NewJob, OriginMode
from meshdeform.requests.document import JobRequest
from tests.cases import each_case
from tests.claims import claim_job
from tests.integration.conftest import Api, new_job
from tests.integration.http_calls import PROMPT, check_document, check_problem, finished_job, kept

BRANCH = {"prompt": "a vase", "params": {"preset": "preview"}}


def interrupted_job(
    api: Api,
    *,
    steps: tuple[int, ...] = (),
    state: JobState = JobState.FAILED,
    error: JobError | None = None,
    **request: Any,
) -> str:
    """A job that a worker has ended, with checkpoints."""
    asked = JobRequest.model_validate({"prompt": "a mushroom", **request})
    job = api.record.create(NewJob(asked, {"asset": kept(api, b"the asset")}))
    assert claim_job(api.record.leases, job.id, "worker", 60.0)
    for step in steps:
        name = f"jobs/{job.id}/1/checkpoint-{step:06}"
        made = api.store.put(name, f"{job.id} {step}".encode())
        api.record.leases.set_checkpoint(job.id, 1, name, step, made.sha256, size=made.size)
    if state is not JobState.RUNNING:
        api.record.leases.finish(job.id, 1, state, error)
    return job.id


def made_of(api: Api, answer: Any) -> Job:
    assert answer.status_code == 202, answer.text
    assert answer.headers["location"] == f"/v1/jobs/{answer.json()['id']}"
    return api.record.get(answer.json()["id"])


@each_case("state", [JobState.FAILED, JobState.CANCELED, JobState.EXPIRED])
def test_a_retry_goes_on_from_the_last_checkpoint(api: Api, openapi: dict[str, Any], state: JobState) -> None:
    source = interrupted_job(api, steps=(100, 200), state=state, metadata={"a": "b"}, priority=7, params={"seed": 3})
    answer = api.http.post(f"/v1/jobs/{source}/retry")
    job, old = made_of(api, answer), api.record.get(source)
    check_document(answer.json(), "JobView", openapi)
    assert answer.json()["origin"] == {"job_id": source, "step": 200, "mode": "retry"}
    assert answer.json()["priority"] == 7
    assert (job.request, job.files, job.state) == (old.request, old.files, JobState.QUEUED)
    assert job.origin is not None
    assert (job.origin.mode, job.origin.step) == (OriginMode.RETRY, 200)
    assert api.http.delete(f"/v1/jobs/{source}").status_code == 204
    assert api.store.get(job.origin.key) == f"{source} 200".encode()
    assert api.store.sha256_of(job.origin.key) == job.origin.sha256
    assert api.store.get(job.files["asset"].key) == b"the asset"
    api.record.request_cancel(job.id)
    assert api.http.delete(f"/v1/jobs/{job.id}").status_code == 204
    assert not api.store.exists(job.origin.key)


@pytest.mark.both_databases
def test_jobs_that_failed_for_one_reason_are_listed_and_each_is_retried_once(api: Api) -> None:
    away, wrong = JobError.of(UnavailableError("The store is away.")), JobError.of(PromptError("Too long."))
    failed = [interrupted_job(api, steps=(100,), error=away) for _ in range(3)]
    interrupted_job(api, error=wrong)
    interrupted_job(api, state=JobState.CANCELED)
    listed = api.http.get("/v1/jobs", params={"error": "unavailable"}).json()["jobs"]
    assert [job["id"] for job in listed] == failed[::-1]
    with Client(api.url) as client:  # the loop of docs/client.md, twice
        first, second = (
            [client.retry(job, idempotency_key=f"again-{job.id}").id for job in client.jobs(error="unavailable")]
            for _ in range(2)
        )
    assert len(set(first)) == 3
    assert second == first


def test_a_retry_may_run_for_longer(api: Api) -> None:
    source = interrupted_job(api, steps=(100,), max_run_s=60.0)
    with Client(api.url) as client:
        assert api.record.get(client.retry(source, max_run_s=7200.0).id).request.max_run_s == 7200.0
        assert api.record.get(client.retry(source).id).request.max_run_s == 60.0
    url = f"/v1/jobs/{source}/retry"
    check_problem(api.http.post(url, json={"max_run_s": 0.1}), 422, "parameter_invalid")
    check_problem(api.http.post(url, json={"prompt": "a vase"}), 422, "parameter_invalid")
    key = {"Idempotency-Key": "longer"}
    assert api.http.post(url, json={}, headers=key).status_code == 202
    assert api.http.post(url, headers=key).headers["idempotency-replayed"] == "true"
    check_problem(api.http.post(url, json={"max_run_s": 90.0}, headers=key), 422, "idempotency_mismatch")


def test_a_retry_takes_the_last_checkpoint_that_is_whole(api: Api) -> None:
    source = interrupted_job(api, steps=(100, 200, 300))
    api.store.put(f"jobs/{source}/1/checkpoint-000300", b"torn")
    api.store.delete(f"jobs/{source}/1/checkpoint-000200")
    job = made_of(api, api.http.post(f"/v1/jobs/{source}/retry"))
    assert job.origin is not None
    assert job.origin.step == 100
    api.store.put(f"jobs/{source}/1/checkpoint-000100", b"torn")
    # The copy of it is whole still, but the job's own are not: what is stored is not taken on faith.
    again = made_of(api, api.http.post(f"/v1/jobs/{source}/retry"))
    assert again.origin is not None
    assert (again.origin.step, again.origin.key) == (0, "")


def test_a_retry_of_a_branch_without_checkpoints_begins_where_the_branch_began(api: Api) -> None:
    source = interrupted_job(api, steps=(100,))
    first = made_of(api, api.http.post(f"/v1/jobs/{source}/checkpoints/100/branch", json=BRANCH))
    api.record.request_cancel(first.id)
    again = made_of(api, api.http.post(f"/v1/jobs/{first.id}/retry"))
    assert again.origin == first.origin
    assert again.request == first.request


def test_only_what_did_not_succeed_is_tried_again(api: Api) -> None:
    for job_id, state in ((finished_job(api), "succeeded"), (new_job(api.record).id, "queued")):
        problem = check_problem(api.http.post(f"/v1/jobs/{job_id}/retry"), 409, "conflict")
        assert problem["state"] == state
    check_problem(api.http.post("/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6/retry"), 404, "not_found")


@each_case("state", [JobState.RUNNING, JobState.SUCCEEDED, JobState.FAILED])
def test_a_branch_begins_with_a_checkpoint_and_asks_for_something_else(
    api: Api, openapi: dict[str, Any], state: JobState
) -> None:
    source = interrupted_job(api, steps=(100, 200), state=state)
    answer = api.http.post(f"/v1/jobs/{source}/checkpoints/100/branch", json={**BRANCH, "metadata": {"take": "2"}})
    job = made_of(api, answer)
    check_document(answer.json(), "JobView", openapi)
    assert answer.json()["origin"] == {"job_id": source, "step": 100, "mode": "branch"}
    assert (job.prompt, job.request.metadata, job.files) == ("a vase", {"take": "2"}, api.record.get(source).files)
    assert job.origin is not None
    assert api.store.get(job.origin.key) == f"{source} 100".encode()


def test_a_branch_may_not_tell_an_address_that_is_not_allowed(api: Api) -> None:
    source = interrupted_job(api, steps=(100,))
    document = {**BRANCH, "webhook": {"url": "http://10.0.0.1/"}}
    refused = api.http.post(f"/v1/jobs/{source}/checkpoints/100/branch", json=document)
    assert (refused.status_code, refused.json()["code"]) == (422, "webhook_address")


def test_a_branch_may_have_a_target_of_its_own(api: Api, sphere: bytes) -> None:
    source = interrupted_job(api, steps=(100,))
    path = f"/v1/jobs/{source}/checkpoints/100/branch"
    guided = {"params": {"guidance": {"kind": "target"}}}
    check_problem(api.http.post(path, json=guided), 422, "parameter_invalid")
    named = {**guided, "target": {"job_id": finished_job(api, sphere)}}
    job = made_of(api, api.http.post(path, json=named))
    assert api.store.get(job.files["target"].key) == sphere
    # Its own branch inherits the target, and one that is led by a prompt does not.
    claim_job(api.record.leases, job.id, "worker", 60.0)
    made = api.store.put(f"jobs/{job.id}/1/checkpoint-000010", b"ten")
    api.record.leases.set_checkpoint(job.id, 1, f"jobs/{job.id}/1/checkpoint-000010", 10, made.sha256)
    path = f"/v1/jobs/{job.id}/checkpoints/10/branch"
    assert made_of(api, api.http.post(path, json=guided)).files == job.files
    egg = build_glb(icosphere(1).verts * [1, 2, 1], icosphere(1).faces)
    again = api.http.post(path, json={**guided, "target": {"job_id": finished_job(api, egg)}})
    assert api.store.get(made_of(api, again).files["target"].key) == egg
    assert made_of(api, api.http.post(path, json=BRANCH)).files == {"asset": job.files["asset"]}


def test_a_checkpoint_that_is_not_there_or_not_whole_is_not_found(api: Api) -> None:
    source = interrupted_job(api, steps=(100, 200))
    problem = check_problem(api.http.post(f"/v1/jobs/{source}/checkpoints/150/branch", json=BRANCH), 404, "not_found")
    assert problem["steps"] == [100, 200]
    api.store.put(f"jobs/{source}/1/checkpoint-000100", b"torn")
    check_problem(api.http.post(f"/v1/jobs/{source}/checkpoints/100/branch", json=BRANCH), 404, "not_found")
    check_problem(api.http.post(f"/v1/jobs/{source}/checkpoints/-1/branch", json=BRANCH), 404, "not_found")


def test_a_branch_has_the_mesh_of_its_job(api: Api) -> None:
    source = interrupted_job(api, steps=(100,), output={"subdivide": True}, params={"control": {"exclude": ["Ground"]}})
    path = f"/v1/jobs/{source}/checkpoints/100/branch"
    job = made_of(api, api.http.post(path, json={**BRANCH, "output": {"morph": True}}))
    assert (job.request.output.subdivide, job.request.output.morph) == (True, True)
    assert job.request.params.control.exclude == ("Ground",)
    for different, place in (
        ({"output": {"subdivide": False}}, ["output", "subdivide"]),
        ({"params": {"control": {"exclude": []}}}, ["params", "control", "exclude"]),
    ):
        problem = check_problem(api.http.post(path, json={**BRANCH, **different}), 422, "parameter_invalid")
        assert problem["errors"][0]["loc"] == place


@each_case(
    ("document", "code"),
    [({}, "prompt_invalid"), ({**PROMPT, "asset": {}}, "parameter_invalid"), ([], "parameter_invalid")],
)
def test_a_branch_that_could_not_run_is_refused(api: Api, document: Any, code: str) -> None:
    source = interrupted_job(api, steps=(100,))
    check_problem(api.http.post(f"/v1/jobs/{source}/checkpoints/100/branch", json=document), 422, code)


@each_case("kind", ["sds", "exemplar"])
def test_a_branch_without_a_kind_has_that_of_its_job(api: Api, kind: str) -> None:
    source = interrupted_job(api, steps=(100,), params={"guidance": {"kind": kind}})
    path = f"/v1/jobs/{source}/checkpoints/100/branch"
    job = made_of(api, api.http.post(path, json={"prompt": "a vase", "params": {"seed": 3}}))
    assert job.document["params"]["guidance"] == {"kind": kind}
    pushed = api.http.post(path, json={"prompt": "a vase", "params": {"steps": 30}})
    if kind == "sds":
        assert made_of(api, pushed).document["params"]["guidance"] == {"kind": "sds"}
    else:
        assert "no optimiser can go on" in check_problem(pushed, 422, "parameter_invalid")["detail"]
