"""Looking at jobs, listing, canceling and deleting them, over real sockets."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

from meshdeform.errors import UnavailableError
from meshdeform.record.models import JobState, NewJob, Progress
from meshdeform.record.queue import JobQueue
from meshdeform.requests.document import JobRequest
from tests.cases import each_case
from tests.claims import claim_job
from tests.integration.conftest import Api, new_job, serving_app, stored_file
from tests.integration.http_calls import check_document, check_problem, finished_job
from tests.waiting import until


def test_a_job_shows_its_progress_and_its_version(api: Api, openapi: dict[str, Any]) -> None:
    job = new_job(api.record)
    claim_job(api.record.leases, job.id, "worker", 60.0)
    progress = Progress(
        step=3, total_steps=10, fraction=0.3, phase="optimizing", losses={"guidance": 0.5}, eta_s=2.0, attempt=1
    )
    api.record.leases.save_progress(job.id, 1, progress)
    first = api.http.get(f"/v1/jobs/{job.id}")
    check_document(first.json(), "JobView", openapi)
    assert first.json()["progress"] == progress.model_dump()
    assert first.json()["state"] == "running"
    tag = first.headers["etag"]
    assert tag.startswith('W/"')
    for header in (tag, f'"other", {tag}', "*", tag.removeprefix("W/")):
        unchanged = api.http.get(f"/v1/jobs/{job.id}", headers={"If-None-Match": header})
        assert (unchanged.status_code, unchanged.content) == (304, b"")
        assert unchanged.headers["etag"] == tag
        assert "retry-after" in unchanged.headers
    api.record.leases.finish(job.id, 1, JobState.SUCCEEDED)
    changed = api.http.get(f"/v1/jobs/{job.id}", headers={"If-None-Match": tag})
    assert changed.status_code == 200
    assert changed.headers["etag"] != tag
    assert "retry-after" not in changed.headers
    assert changed.json()["finished_at"].endswith("Z")


@each_case(
    ("query", "loc"),
    [
        ("state=flying", "state"),
        ("limit=0", "limit"),
        ("limit=201", "limit"),
        ("cursor=xyz", "cursor"),
        ("metadata[]=x", "metadata"),
        ("metadata[a]=%00", "metadata"),
        ("cursor=am9iXwA", "cursor"),
        ("metadata[a]=1&metadata[a]=2", "metadata"),
        (f"metadata[a]={'x' * 501}", "metadata"),
        ("&".join(f"metadata[{i}]=" for i in range(33)), "metadata"),
    ],
)
def test_a_bad_query_is_a_clear_problem(api: Api, query: str, loc: str) -> None:
    problem = check_problem(api.http.get(f"/v1/jobs?{query}"), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"][:2] == ["query", loc]


def test_cancel_and_delete_follow_the_state(api: Api) -> None:
    job = new_job(api.record)
    claim_job(api.record.leases, job.id, "worker", 60.0)
    check_problem(api.http.delete(f"/v1/jobs/{job.id}"), 409, "conflict")
    queue = JobQueue(api.settings.redis_url, api.settings.queue)
    with queue.listen_for_cancel(job.id) as listener:
        assert not listener.wait(0.05)
        assert api.http.post(f"/v1/jobs/{job.id}/cancel").json()["state"] == "canceling"
        assert listener.wait(30.0)
    queue.close()
    check_problem(api.http.delete(f"/v1/jobs/{job.id}"), 409, "conflict")
    api.record.leases.finish(job.id, 1, JobState.CANCELED)
    again = api.http.post(f"/v1/jobs/{job.id}/cancel")
    assert (again.status_code, again.json()["state"]) == (200, "canceled")
    answer = api.http.delete(f"/v1/jobs/{job.id}")
    assert (answer.status_code, answer.content) == (204, b"")
    check_problem(api.http.get(f"/v1/jobs/{job.id}"), 404, "not_found")
    check_problem(api.http.delete(f"/v1/jobs/{job.id}"), 404, "not_found")
    assert check_problem(api.http.post(f"/v1/jobs/{finished_job(api)}/cancel"), 409, "conflict")["state"] == "succeeded"


@each_case("job_id", ["job_01kg9zqk2xf3v8c5m7n9p1r4t6", "nonsense", "%2e%2e", "job_" + "0" * 500])
def test_an_unknown_job_is_not_found(api: Api, job_id: str) -> None:
    for method, path in (
        ("GET", ""),
        ("DELETE", ""),
        ("POST", "/cancel"),
        ("GET", "/artifacts"),
        ("GET", "/artifacts/x"),
        ("GET", "/events"),
        ("GET", "/events?format=stream"),
    ):
        assert api.http.request(method, f"/v1/jobs/{job_id}{path}").status_code == 404
    check_problem(api.http.get("/v1/jobs/nonsense"), 404, "not_found")


def test_a_job_stays_readable_whatever_it_holds(api: Api, openapi: dict[str, Any]) -> None:
    request = JobRequest(prompt="a vase", metadata={"ключ": "\u0001\ud7ff</script>"})
    job = api.record.create(NewJob(request, {"asset": stored_file("a", "größe 1.glb")}))
    document = api.http.get(f"/v1/jobs/{job.id}").json()
    check_document(document, "JobView", openapi)
    assert document["metadata"] == request.metadata
    assert document["asset"]["filename"] == "größe 1.glb"


def test_a_job_is_deleted_while_the_store_is_away(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    job_id = finished_job(api)
    (artifact,) = api.record.artifacts(job_id)
    with serving_app(api.settings) as (url, app):

        def away(prefix: str) -> None:
            raise UnavailableError("away")

        # There is another reconciler, of the fixture's API, which removes what this one cannot.
        monkeypatch.setattr(app.state.app_state.store, "delete_prefix", away)
        assert httpx.delete(f"{url}/v1/jobs/{job_id}").status_code == 204
        check_problem(httpx.get(f"{url}/v1/jobs/{job_id}"), 404, "not_found")
    until(lambda: not api.store.exists(artifact.key))
