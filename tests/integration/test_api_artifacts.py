"""Downloading artifacts over real sockets, whole and in parts."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from meshdeform.client import Client
from meshdeform.errors import JobNotFinishedError, NumericalError
from meshdeform.record.models import JobError, JobState
from tests.claims import claim_job
from tests.integration.conftest import Api, new_job, stored_result
from tests.integration.http_calls import check_document, check_problem, finished_job
from tests.waiting import until


@pytest.fixture
def client(api: Api) -> Iterator[Client]:
    with Client(api.url, max_retries=0) as made:
        yield made


def test_artifacts_are_listed_and_streamed(api: Api, openapi: dict[str, Any]) -> None:
    content = bytes(range(256)) * 4096
    job_id = finished_job(api, content)
    listed = api.http.get(f"/v1/jobs/{job_id}/artifacts").json()
    check_document(listed, "ArtifactList", openapi)
    (artifact,) = listed["artifacts"]
    digest = hashlib.sha256(content).hexdigest()
    assert (artifact["name"], artifact["size"], artifact["sha256"]) == ("result.glb", len(content), digest)
    assert api.http.get(f"/v1/jobs/{job_id}").json()["artifacts"] == listed["artifacts"]
    assert api.http.get("/v1/jobs?limit=1").json()["jobs"][0]["artifacts"] == listed["artifacts"]
    whole = api.http.get(artifact["href"])
    assert (whole.status_code, whole.content) == (200, content)
    assert whole.headers["content-type"] == "model/gltf-binary"
    assert whole.headers["content-length"] == str(len(content))
    assert whole.headers["etag"] == f'"{digest}"'
    assert whole.headers["accept-ranges"] == "bytes"
    assert whole.headers["content-disposition"] == 'attachment; filename="sphere-a-mushroom-seed0.glb"'
    assert whole.headers["x-content-type-options"] == "nosniff"
    head = api.http.head(artifact["href"])
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-length"] == str(len(content))
    have = api.http.get(artifact["href"], headers={"If-None-Match": whole.headers["etag"]})
    assert (have.status_code, have.content) == (304, b"")


def test_an_artifact_whose_object_is_gone_is_an_error_before_the_first_byte(api: Api) -> None:
    job_id = finished_job(api)
    api.store.delete(api.record.artifacts(job_id)[0].key)
    check_problem(api.http.get(f"/v1/jobs/{job_id}/artifacts/result.glb"), 404, "not_found")


def test_a_result_requested_too_early_or_of_a_job_without_one(api: Api, client: Client, tmp_path: Path) -> None:
    job = new_job(api.record)
    url = f"/v1/jobs/{job.id}/artifacts/result.glb"
    for early in (api.http.get(url), api.http.post(f"{url}/url")):
        problem = check_problem(early, 409, "job_not_finished")
        assert (early.headers["retry-after"], problem["state"]) == ("1", "queued")
    for download in (lambda: client.read(job.id, "result.glb"), lambda: client.fetch(job.id, tmp_path)):
        with pytest.raises(JobNotFinishedError, match="queued"):
            download()
    assert claim_job(api.record.leases, job.id, "worker", 60.0)
    error = JobError.of(NumericalError("The loss is not finite."))
    api.record.leases.finish(job.id, 1, JobState.FAILED, error)
    problem = check_problem(api.http.get(url), 404, "not_found")
    assert problem["detail"] == "There is no artifact 'result.glb'. The job failed: The loss is not finite."
    assert problem["state"] == "failed"
    with pytest.raises(NumericalError):
        client.fetch(job.id, tmp_path)
    canceled = new_job(api.record)
    api.record.request_cancel(canceled.id)
    problem = check_problem(api.http.get(f"/v1/jobs/{canceled.id}/artifacts/result.glb"), 404, "not_found")
    problem = check_problem(api.http.get(f"/v1/jobs/{finished_job(api)}/artifacts/other.glb"), 404, "not_found")
    assert problem["artifacts"] == ["result.glb"]


# Checkpoints, and the shape at each


def store_checkpoint(api: Api, job_id: str, attempt: int, step: int, mesh: bytes | None) -> None:
    """What a worker does: the objects first, then the record."""
    key = f"jobs/{job_id}/{attempt}/checkpoint-{step:06d}"
    state = api.store.put(key, b"state" * step)
    made = None
    if mesh is not None:
        made = stored_result(api.store, f"{key}.glb", mesh).model_copy(update={"name": "mesh.glb"})
    api.record.leases.set_checkpoint(job_id, attempt, key, step, state.sha256, size=state.size, mesh=made)


def test_checkpoints_are_listed_by_step_and_the_newest_attempt_counts(api: Api, openapi: dict[str, Any]) -> None:
    job = new_job(api.record)
    path = f"/v1/jobs/{job.id}/checkpoints"
    assert api.http.get(path).json() == {"checkpoints": []}
    assert claim_job(api.record.leases, job.id, "first", 60.0)
    store_checkpoint(api, job.id, 1, 5, b"five of the first")
    store_checkpoint(api, job.id, 1, 10, b"ten of the first")
    store_checkpoint(api, job.id, 1, 15, None)
    assert api.record.leases.worker_ended("first")
    # The server's own reconciler may be the one that takes it back.
    api.record.upkeep.reclaim_expired(3)
    until(lambda: api.record.get(job.id).state is JobState.QUEUED, "it is taken back")
    assert claim_job(api.record.leases, job.id, "second", 60.0)
    store_checkpoint(api, job.id, 2, 10, b"ten of the second")
    store_checkpoint(api, job.id, 2, 20, b"twenty of the second")
    listed = api.http.get(path).json()
    check_document(listed, "CheckpointList", openapi)
    found = listed["checkpoints"]
    assert [(one["step"], one["attempt"], one["size"]) for one in found] == [
        (5, 1, 25),
        (10, 2, 50),
        (15, 1, 75),
        (20, 2, 100),
    ]
    assert found[2]["mesh"] is None
    contents = {5: b"five of the first", 10: b"ten of the second", 20: b"twenty of the second"}
    for one in found:
        if one["mesh"] is None:
            continue
        content = contents[one["step"]]
        assert one["mesh"]["href"] == f"{path}/{one['step']}/mesh.glb"
        assert (one["mesh"]["size"], one["mesh"]["sha256"]) == (len(content), hashlib.sha256(content).hexdigest())
        assert api.http.get(one["mesh"]["href"]).content == content


def test_a_mesh_that_is_not_there_says_which_are(api: Api) -> None:
    job = new_job(api.record)
    path = f"/v1/jobs/{job.id}/checkpoints"
    assert check_problem(api.http.get(f"{path}/5/mesh.glb"), 404, "not_found")["steps"] == []
    assert claim_job(api.record.leases, job.id, "worker", 60.0)
    store_checkpoint(api, job.id, 1, 5, b"five")
    store_checkpoint(api, job.id, 1, 7, None)
    for step in ("6", "7"):
        assert check_problem(api.http.get(f"{path}/{step}/mesh.glb"), 404, "not_found")["steps"] == [5]
    for nonsense in ("-1", "x", "99999999999"):
        check_problem(api.http.get(f"{path}/{nonsense}/mesh.glb"), 404, "not_found")
    check_problem(api.http.get("/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6/checkpoints"), 404, "not_found")
