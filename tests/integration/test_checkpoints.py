"""Checkpoints over real sockets: which there are, and the shape at each."""

from __future__ import annotations

import hashlib
from typing import Any

from meshdeform.record.models import JobState
from tests.integration.conftest import Api, new_job, stored_result
from tests.integration.http_calls import check_document, check_problem
from tests.waiting import until


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
    assert api.record.leases.claim(job.id, "first", 60.0)
    store_checkpoint(api, job.id, 1, 5, b"five of the first")
    store_checkpoint(api, job.id, 1, 10, b"ten of the first")
    store_checkpoint(api, job.id, 1, 15, None)
    assert api.record.leases.worker_ended("first")
    # The server's own reconciler may be the one that takes it back.
    api.record.upkeep.reclaim_expired(3)
    until(lambda: api.record.get(job.id).state is JobState.QUEUED, "it is taken back")
    assert api.record.leases.claim(job.id, "second", 60.0)
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
    assert api.record.leases.claim(job.id, "worker", 60.0)
    store_checkpoint(api, job.id, 1, 5, b"five")
    store_checkpoint(api, job.id, 1, 7, None)
    for step in ("6", "7"):
        assert check_problem(api.http.get(f"{path}/{step}/mesh.glb"), 404, "not_found")["steps"] == [5]
    for nonsense in ("-1", "x", "99999999999"):
        check_problem(api.http.get(f"{path}/{nonsense}/mesh.glb"), 404, "not_found")
    check_problem(api.http.get("/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6/checkpoints"), 404, "not_found")
