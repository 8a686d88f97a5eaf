"""Jobs that taught the builtin prior: those of before are shown and downloaded, and none is made or run any more."""

from __future__ import annotations

import json
from typing import Any

import pytest

from meshdeform.errors import KindRetiredError
from meshdeform.record.models import EventType, JobState
from meshdeform.record.queue import JobQueue
from meshdeform.record.reconciler import Reconciler
from meshdeform.record.repository import JobRecord
from service.jobs.estimates import estimate
from tests.cases import each_case
from tests.claims import claim_job
from tests.integration.conftest import Api, stored_file
from tests.integration.http_calls import check_problem, finished_job, kept, post
from tests.integration.other_versions import accepted_elsewhere
from tests.integration.record_calls import LEASE_S, history, posted, set_to

LESSON: dict[str, Any] = {"kind": "prior_teach", "params": {"noun": "a gnome", "steps": 600}}
MESHES = {"meshes": stored_file().model_dump()}


@pytest.mark.both_databases
def test_a_queued_lesson_fails_and_no_worker_takes_it(record: JobRecord, redis_url: str) -> None:
    record.webhooks.create("", "https://hooks.example/")
    lesson, other = accepted_elsewhere(record, LESSON, files=MESHES), posted(record)
    assert claim_job(record.leases, lesson.id, "worker", LEASE_S) is None
    estimate(record.database, record.leases, other.request, default_model="builtin", queue="test")
    queue = JobQueue(redis_url, "test")
    try:
        Reconciler(record, queue, 3, LEASE_S).run_once()
    finally:
        queue.close()
    ended = record.get(lesson.id)
    assert (ended.state, ended.error and ended.error.code) == (JobState.FAILED, "kind_retired")
    assert ended.error is not None
    assert "meshdeform words add" in ended.error.advice
    assert history(record, lesson.id) == [EventType.QUEUED, EventType.FAILED]
    assert record.get(other.id).state is JobState.QUEUED
    with pytest.raises(KindRetiredError):
        _ = ended.request


def test_a_lesson_of_before_is_listed_and_its_files_are_downloaded(api: Api) -> None:
    packed = kept(api, b"PK and so on", "gnomes.zip")
    job_id = finished_job(
        api, b"unused", files={"asset": packed}, more={"weights.safetensors": b"weights", "report.json": b"{}"}
    )
    files = {"meshes": packed.model_dump()}
    set_to(api.record, api.record.get(job_id), request=LESSON, kind="prior_teach", files=files)
    shown = api.http.get(f"/v1/jobs/{job_id}").json()
    assert shown in api.http.get("/v1/jobs").json()["jobs"]
    assert (shown["kind"], shown["params"]["noun"], shown["state"]) == ("prior_teach", "a gnome", "succeeded")
    assert "no longer run" in shown["unreadable"]
    assert api.http.get(f"/v1/jobs/{job_id}/artifacts/weights.safetensors").content == b"weights"
    assert api.http.get(f"/v1/jobs/{job_id}/files/meshes").content == b"PK and so on"
    branch = api.http.post(f"/v1/jobs/{job_id}/checkpoints/1/branch", json={"prompt": "a vase"})
    check_problem(branch, 422, "kind_retired")
    assert api.http.delete(f"/v1/jobs/{job_id}").status_code == 204


def test_a_lesson_that_failed_is_not_retried_nor_a_job_with_what_one_taught(api: Api, sphere: bytes) -> None:
    lesson = accepted_elsewhere(api.record, LESSON, files=MESHES)
    api.record.upkeep.fail_retired()
    check_problem(api.http.post(f"/v1/jobs/{lesson.id}/retry"), 422, "kind_retired")
    taught = {"prompt": "a gnome", "params": {"guidance": {"kind": "sds", "model": f"job:{lesson.id}"}}}
    files = {name: kept(api, sphere).model_dump() for name in ("asset", "weights")}
    user = set_to(api.record, posted(api.record), request=taught, files=files)
    api.record.request_cancel(user.id)
    check_problem(api.http.post(f"/v1/jobs/{user.id}/retry"), 422, "kind_retired")
    assert api.http.get(f"/v1/jobs/{user.id}").json()["unreadable"] is None


@each_case(
    "request",
    [
        LESSON,
        {"kind": "prior_teach", "params": {}, "files": {"meshes": {"upload_id": f"upl_{'0' * 26}"}}},
        {"prompt": "a gnome", "params": {"guidance": {"model": "mine.safetensors"}}},
        {"prompt": "a gnome", "params": {"guidance": {"kind": "sds", "model": "weights"}}},
        {"prompt": "a gnome", "params": {"guidance": {"model": f"job:job_{'0' * 26}"}}},
        {"prompt": "a vase", "files": {"weights": {"upload_id": f"upl_{'0' * 26}"}}},
    ],
)
def test_new_ones_are_refused_with_what_to_do_instead(api: Api, sphere: bytes, request: dict[str, Any]) -> None:
    before = api.http.get("/v1/jobs").json()
    problem = check_problem(post(api, sphere, request), 422, "kind_retired")
    assert "meshdeform words add" in problem["advice"]
    assert "POST /v1/words" in problem["advice"]
    form = {"asset": ("sphere.glb", sphere), "request": (None, json.dumps(request))}
    check_problem(api.http.post("/v1/jobs:validate", files=form), 422, "kind_retired")
    assert api.http.get("/v1/jobs").json() == before


@each_case("part", ["meshes", "weights"])
def test_their_files_are_refused_as_parts_of_a_form(api: Api, sphere: bytes, part: str) -> None:
    check_problem(post(api, sphere, **{part: ("mine.bin", b"data")}), 422, "kind_retired")
