"""The HTTP API over real sockets, with a real Redis, SQLite or PostgreSQL, and files on disk."""

from __future__ import annotations

import hashlib
import json
import re
import struct
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx
import jsonschema
import pytest

from meshdeform.config import JobRequest
from meshdeform.errors import UnavailableError
from meshdeform.jobs.ids import JOB_ID_PATTERN
from meshdeform.jobs.models import Artifact, JobState, Progress
from meshdeform.jobs.queue import JobQueue
from meshdeform.jobs.reconciler import Reconciler
from meshdeform.jobs.record import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from tests.integration.conftest import Api, new_job, serving, stored_file
from tests.servers import free_port

PROMPT = {"prompt": "a mushroom"}


@pytest.fixture(scope="module")
def sphere(repository: Path) -> bytes:
    return (repository / "examples" / "sphere.glb").read_bytes()


@pytest.fixture(scope="module")
def openapi(repository: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((repository / "openapi" / "openapi.json").read_text())
    return document


def post(api: Api, asset: bytes, request: Any = PROMPT, filename: str = "sphere.glb", **more: Any) -> httpx.Response:
    """Post a job; a request that is no string is sent as JSON."""
    document = request if isinstance(request, str | bytes) else json.dumps(request)
    files = {"asset": (filename, asset), "request": (None, document), **more}
    return api.http.post("/v1/jobs", files=files)


def check_problem(answer: httpx.Response, status: int, code: str) -> dict[str, Any]:
    """Check that an answer is a problem document, and return it."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    assert (problem["status"], problem["code"]) == (status, code)
    assert problem["type"] == f"urn:meshdeform:problem:{code}"
    assert problem["instance"] == answer.request.url.path
    for member in ("title", "detail", "advice"):
        assert problem[member]
    return problem


def check_document(document: Any, name: str, openapi: dict[str, Any]) -> None:
    """Check a document against its schema as it is published."""
    schema = {"$ref": f"#/components/schemas/{name}", "components": openapi["components"]}
    jsonschema.Draft202012Validator(schema, format_checker=jsonschema.FormatChecker()).validate(document)


def glb(document: dict[str, Any], binary: bytes = b"") -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def finished_job(api: Api, content: bytes = bytes(range(256)) * 64) -> str:
    """A job that a worker has brought to its end, with one artifact."""
    job = new_job(api.record)
    assert api.record.claim(job.id, "worker", 60.0)
    key = f"jobs/{job.id}/1/result.glb"
    stored = api.store.put(key, content)
    made = Artifact(
        name="result.glb",
        content_type="model/gltf-binary",
        size=stored.size,
        sha256=stored.sha256,
        key=key,
        created_at=datetime.now(UTC),
    )
    api.record.add_artifact(job.id, 1, made)
    api.record.finish(job.id, 1, JobState.SUCCEEDED)
    return job.id


def test_a_posted_job_is_accepted_recorded_stored_and_told(api: Api, sphere: bytes, openapi: dict[str, Any]) -> None:
    request = {"prompt": "a mushroom", "params": {"preset": "preview", "seed": 7}, "metadata": {"shot": "sc010"}}
    answer = post(api, sphere, request, filename="C:\\models\\my sphere.glb")
    assert answer.status_code == 202, answer.text
    job = answer.json()
    check_document(job, "JobView", openapi)
    assert re.fullmatch(JOB_ID_PATTERN, job["id"])
    assert answer.headers["location"] == f"/v1/jobs/{job['id']}"
    assert int(answer.headers["retry-after"]) >= 1
    assert job["state"] == "queued"
    assert job["params"] == {"preset": "preview", "seed": 7}
    assert job["metadata"] == {"shot": "sc010"}
    digest = hashlib.sha256(sphere).hexdigest()
    assert job["asset"] == {"filename": "my sphere.glb", "size": len(sphere), "sha256": digest}
    assert api.store.get(f"assets/{digest}") == sphere
    assert api.http.get(answer.headers["location"]).json() == job
    queue = JobQueue(api.settings.redis_url, api.settings.queue)
    assert job["id"] in queue.told()
    queue.close()


def test_the_request_may_be_a_file_part_and_a_target_may_come_along(api: Api, sphere: bytes) -> None:
    document = ("request.json", json.dumps({"params": {"guidance": "target"}}), "application/json")
    files = {"request": document, "target": ("t.glb", sphere), "asset": ("a.glb", sphere)}
    answer = api.http.post("/v1/jobs", files=files)
    assert answer.status_code == 202, answer.text
    job = api.record.get(answer.json()["id"])
    assert job.target is not None
    assert job.target.key == job.asset.key
    assert (job.asset.filename, job.target.filename) == ("a.glb", "t.glb")


def test_the_same_bytes_are_stored_once_and_outlive_one_of_two_jobs(api: Api, repository: Path) -> None:
    cube = (repository / "examples" / "cube.glb").read_bytes()
    first, second = (post(api, cube).json()["id"] for _ in range(2))
    key = api.record.get(first).asset.key
    assert api.record.get(second).asset.key == key
    for job_id, left in ((first, True), (second, False)):
        assert api.http.post(f"/v1/jobs/{job_id}/cancel").json()["state"] == "canceled"
        assert api.http.delete(f"/v1/jobs/{job_id}").status_code == 204
        assert api.store.exists(key) is left


BARE = {"asset": {"version": "2.0"}}
HUGE = {
    **BARE,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"componentType": 5126, "count": 200_000_000, "type": "VEC3"}],
}
NAN = {
    **HUGE,
    "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3", "bufferView": 0}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36}],
}
EXTERNAL = {**NAN, "buffers": [{"byteLength": 36, "uri": "file:///etc/passwd"}]}


@pytest.mark.parametrize(
    ("asset", "status", "code"),
    [
        (b"", 422, "asset_truncated"),
        (b"PK\x03\x04 no mesh at all", 415, "asset_format"),
        (glb(BARE)[:-4], 422, "asset_truncated"),
        (glb(HUGE), 413, "asset_too_large"),
        (glb(EXTERNAL), 422, "asset_external_uri"),
        (glb(NAN, struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, float("nan"), 0)), 422, "asset_not_finite"),
        (glb(BARE), 422, "asset_no_triangles"),
    ],
    ids=["empty", "zip", "truncated", "huge", "external", "nan", "no triangles"],
)
def test_a_bad_asset_is_a_clear_problem_and_leaves_nothing(api: Api, asset: bytes, status: int, code: str) -> None:
    before = api.record.list_jobs().jobs
    check_problem(post(api, asset, filename="x.bin" if asset.startswith(b"PK") else "x.glb"), status, code)
    assert api.record.list_jobs().jobs == before
    assert not api.store.exists(f"assets/{hashlib.sha256(asset).hexdigest()}")


@pytest.mark.parametrize(
    ("request_", "code", "loc"),
    [
        ("{", "request_invalid", None),
        (b"\xff\xfe", "request_invalid", None),
        ("[]", "parameter_invalid", []),
        ({}, "prompt_invalid", None),
        ({"prompt": " \t "}, "prompt_invalid", None),
        ({"prompt": "x" * 1001}, "prompt_invalid", None),
        ({"prompt": "a quixotic zeitgeist"}, "prompt_unknown_words", None),
        ({**PROMPT, "colour": "red"}, "parameter_invalid", ["colour"]),
        ({**PROMPT, "kind": "teleport"}, "parameter_invalid", ["kind"]),
        ({**PROMPT, "params": {"stepz": 3}}, "parameter_invalid", ["params", "stepz"]),
        ({**PROMPT, "params": {"steps": 0}}, "parameter_invalid", ["params", "steps"]),
        ('{"prompt": "a mushroom", "params": {"seed": NaN}}', "parameter_invalid", ["params", "seed"]),
        ({**PROMPT, "params": {"guidance": "target"}}, "parameter_invalid", ["params", "guidance"]),
        ({**PROMPT, "params": {"model": "somebody/elses"}}, "model_unavailable", None),
        ({**PROMPT, "metadata": {"a": 1}}, "parameter_invalid", ["metadata", "a"]),
        ('{"prompt": "\\ud800"}', "request_invalid", None),
        ("[" * 100_000, "request_invalid", None),
        ("1" * 100_000, "request_invalid", None),
    ],
    ids=lambda value: value if isinstance(value, str) and value.isidentifier() else None,
)
def test_a_bad_request_is_a_clear_problem(api: Api, sphere: bytes, request_: Any, code: str, loc: Any) -> None:
    problem = check_problem(post(api, sphere, request_), 422, code)
    if loc is not None:
        assert [error["loc"] for error in problem["errors"]] == [loc]
        assert set(problem["errors"][0]) == {"loc", "msg", "type"}


def test_a_target_without_its_guidance_is_refused(api: Api, sphere: bytes) -> None:
    check_problem(post(api, sphere, target=("t.glb", sphere)), 422, "parameter_invalid")


@pytest.mark.parametrize(
    ("files", "named"),
    [
        ({"asset": ("a.glb", b"x")}, "request"),
        ({"request": (None, "{}")}, "asset"),
        ({"asset": ("a.glb", b"x"), "request": (None, "{}"), "extra": ("e", b"x")}, "extra"),
        ([("asset", ("a.glb", b"x")), ("asset", ("b.glb", b"x")), ("request", (None, "{}"))], "twice"),
        ({"asset": ("a.glb", b"x"), "request": (None, "x" * 300_000)}, "longer"),
    ],
)
def test_a_form_with_wrong_parts_says_which(api: Api, files: Any, named: str) -> None:
    assert named in check_problem(api.http.post("/v1/jobs", files=files), 422, "request_invalid")["detail"]


@pytest.mark.parametrize(
    ("content_type", "body"),
    [
        ("application/json", b"{}"),
        ("multipart/form-data", b"--x--"),
        ("multipart/form-data; boundary=x", b""),
        ("multipart/form-data; boundary=x", b'--x\r\nContent-Disposition: form-data; name="asset"\r\n\r\nhalf'),
        ("multipart/form-data; boundary=x", b"nothing of the kind"),
        ("multipart/form-data; boundary=x", b"--x\r\nA: " + b"y" * 20_000),
    ],
)
def test_a_body_that_is_no_such_form_is_refused(api: Api, content_type: str, body: bytes) -> None:
    answer = api.http.post("/v1/jobs", content=body, headers={"Content-Type": content_type})
    check_problem(answer, 422, "request_invalid")


@pytest.mark.parametrize("declared", [True, False], ids=["with a length", "chunked"])
def test_a_body_over_the_limit_is_refused_before_it_is_read(api: Api, declared: bool) -> None:
    sent = 0
    head = b'--x\r\nContent-Disposition: form-data; name="asset"; filename="a.glb"\r\n\r\n'
    total = 64 * 2**20

    def body() -> Any:
        nonlocal sent
        yield head
        while sent < total:
            sent += 2**16
            yield bytes(2**16)

    headers = {"Content-Type": "multipart/form-data; boundary=x"}
    if declared:
        headers["Content-Length"] = str(total + len(head))
    with httpx.Client(base_url=api.url, timeout=30) as client:
        problem = check_problem(client.post("/v1/jobs", content=body(), headers=headers), 413, "asset_too_large")
    assert problem["limit"] == api.settings.max_upload_bytes
    assert "MESHDEFORM_MAX_UPLOAD_BYTES" in problem["advice"]
    assert sent < total


def test_a_job_shows_its_progress_and_its_version(api: Api, openapi: dict[str, Any]) -> None:
    job = new_job(api.record)
    api.record.claim(job.id, "worker", 60.0)
    progress = Progress(
        step=3, total_steps=10, fraction=0.3, phase="optimizing", losses={"guidance": 0.5}, eta_s=2.0, attempt=1
    )
    api.record.save_progress(job.id, 1, progress)
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
    api.record.finish(job.id, 1, JobState.SUCCEEDED)
    changed = api.http.get(f"/v1/jobs/{job.id}", headers={"If-None-Match": tag})
    assert changed.status_code == 200
    assert changed.headers["etag"] != tag
    assert "retry-after" not in changed.headers
    assert changed.json()["finished_at"].endswith("Z")


def test_a_failed_job_says_why(api: Api, openapi: dict[str, Any]) -> None:
    job = new_job(api.record)
    api.record.claim(job.id, "worker", -1.0)
    api.record.reclaim_expired(1)
    document = api.http.get(f"/v1/jobs/{job.id}").json()
    check_document(document, "JobView", openapi)
    assert (document["state"], document["error"]["code"]) == ("failed", "worker_lost")
    assert document["error"]["advice"]


def test_the_list_goes_through_all_pages(api: Api, openapi: dict[str, Any]) -> None:
    made = [new_job(api.record, prompt=f"a vase {i}").id for i in range(5)]
    page = api.http.get("/v1/jobs", params={"limit": 2}).json()
    check_document(page, "JobList", openapi)
    seen = [job["id"] for job in page["jobs"]]
    while len(seen) < len(made):
        page = api.http.get("/v1/jobs", params={"limit": 2, "cursor": page["next_cursor"]}).json()
        seen += [job["id"] for job in page["jobs"]]
    assert seen[:5] == made[::-1]
    api.record.claim(made[2], "worker", 60.0)
    running = api.http.get("/v1/jobs", params={"state": "running"}).json()["jobs"]
    assert made[2] in [job["id"] for job in running]
    assert {job["state"] for job in running} == {"running"}


@pytest.mark.parametrize(
    ("query", "loc"),
    [("state=flying", "state"), ("limit=0", "limit"), ("limit=201", "limit"), ("cursor=xyz", "cursor")],
)
def test_a_bad_query_is_a_clear_problem(api: Api, query: str, loc: str) -> None:
    problem = check_problem(api.http.get(f"/v1/jobs?{query}"), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["query", loc]


def test_cancel_and_delete_follow_the_state(api: Api) -> None:
    job = new_job(api.record)
    api.record.claim(job.id, "worker", 60.0)
    check_problem(api.http.delete(f"/v1/jobs/{job.id}"), 409, "conflict")
    queue = JobQueue(api.settings.redis_url, api.settings.queue)
    with queue.listen_for_cancel(job.id) as listener:
        assert not listener.wait(0.05)
        assert api.http.post(f"/v1/jobs/{job.id}/cancel").json()["state"] == "canceling"
        assert listener.wait(30.0)
    queue.close()
    check_problem(api.http.delete(f"/v1/jobs/{job.id}"), 409, "conflict")
    api.record.finish(job.id, 1, JobState.CANCELED)
    assert check_problem(api.http.post(f"/v1/jobs/{job.id}/cancel"), 409, "conflict")["state"] == "canceled"
    answer = api.http.delete(f"/v1/jobs/{job.id}")
    assert (answer.status_code, answer.content) == (204, b"")
    check_problem(api.http.get(f"/v1/jobs/{job.id}"), 404, "not_found")
    check_problem(api.http.delete(f"/v1/jobs/{job.id}"), 404, "not_found")


def test_deleting_a_job_removes_its_objects(api: Api) -> None:
    job_id = finished_job(api)
    (artifact,) = api.record.artifacts(job_id)
    orphan = f"jobs/{job_id}/0/checkpoint-000100"
    api.store.put(orphan, b"x")
    assert api.http.delete(f"/v1/jobs/{job_id}").status_code == 204
    assert not api.store.exists(artifact.key)
    assert not api.store.exists(orphan)
    check_problem(api.http.get(f"/v1/jobs/{job_id}/artifacts"), 404, "not_found")


def test_artifacts_are_listed_and_streamed(api: Api, openapi: dict[str, Any]) -> None:
    content = bytes(range(256)) * 4096
    job_id = finished_job(api, content)
    listed = api.http.get(f"/v1/jobs/{job_id}/artifacts").json()
    check_document(listed, "ArtifactList", openapi)
    (artifact,) = listed["artifacts"]
    digest = hashlib.sha256(content).hexdigest()
    assert (artifact["name"], artifact["size"], artifact["sha256"]) == ("result.glb", len(content), digest)
    whole = api.http.get(artifact["href"])
    assert (whole.status_code, whole.content) == (200, content)
    assert whole.headers["content-type"] == "model/gltf-binary"
    assert whole.headers["content-length"] == str(len(content))
    assert whole.headers["etag"] == f'"{digest}"'
    assert whole.headers["accept-ranges"] == "bytes"
    assert whole.headers["content-disposition"] == 'attachment; filename="result.glb"'
    assert whole.headers["x-content-type-options"] == "nosniff"
    head = api.http.head(artifact["href"])
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-length"] == str(len(content))
    have = api.http.get(artifact["href"], headers={"If-None-Match": whole.headers["etag"]})
    assert (have.status_code, have.content) == (304, b"")


def test_parts_of_an_artifact(api: Api) -> None:
    content = bytes(range(256)) * 64
    job_id, size = finished_job(api, content), len(content)
    url = f"/v1/jobs/{job_id}/artifacts/result.glb"
    tag = f'"{hashlib.sha256(content).hexdigest()}"'
    for header, part in {
        "bytes=0-0": slice(0, 1),
        "bytes=100-199": slice(100, 200),
        "bytes=16000-": slice(16000, None),
        "bytes=-10": slice(-10, None),
        "bytes=-99999": slice(0, None),
        "bytes=5-99999": slice(5, None),
    }.items():
        answer = api.http.get(url, headers={"Range": header})
        start, stop, _ = part.indices(size)
        assert (answer.status_code, answer.content) == (206, content[part]), header
        assert answer.headers["content-range"] == f"bytes {start}-{stop - 1}/{size}"
        assert answer.headers["content-length"] == str(stop - start)
    for header in ("bytes=5-4", "bytes=", "bytes=-", "lines=1-2", "bytes=0-1,5-6"):
        assert api.http.get(url, headers={"Range": header}).content == content, header
    same = api.http.get(url, headers={"Range": "bytes=1-2", "If-Range": tag})
    other = api.http.get(url, headers={"Range": "bytes=1-2", "If-Range": '"other"'})
    assert (same.status_code, other.status_code) == (206, 200)
    for header in (f"bytes={size}-", "bytes=-0"):
        answer = api.http.get(url, headers={"Range": header})
        check_problem(answer, 416, "range_not_satisfiable")
        assert answer.headers["content-range"] == f"bytes */{size}"


def test_an_artifact_whose_object_is_gone_is_an_error_before_the_first_byte(api: Api) -> None:
    job_id = finished_job(api)
    api.store.delete(api.record.artifacts(job_id)[0].key)
    check_problem(api.http.get(f"/v1/jobs/{job_id}/artifacts/result.glb"), 404, "not_found")


def test_an_artifact_that_is_not_there_says_what_is(api: Api) -> None:
    problem = check_problem(api.http.get(f"/v1/jobs/{finished_job(api)}/artifacts/nothing.glb"), 404, "not_found")
    assert problem["artifacts"] == ["result.glb"]


@pytest.mark.parametrize("job_id", ["job_01kg9zqk2xf3v8c5m7n9p1r4t6", "nonsense", "%2e%2e", "job_" + "0" * 500])
def test_an_unknown_job_is_not_found(api: Api, job_id: str) -> None:
    for method, path in (
        ("GET", ""),
        ("DELETE", ""),
        ("POST", "/cancel"),
        ("GET", "/artifacts"),
        ("GET", "/artifacts/x"),
    ):
        assert api.http.request(method, f"/v1/jobs/{job_id}{path}").status_code == 404
    check_problem(api.http.get("/v1/jobs/nonsense"), 404, "not_found")


def test_a_route_or_method_that_is_not_there_is_a_problem(api: Api) -> None:
    check_problem(api.http.get("/v2/jobs"), 404, "not_found")
    check_problem(api.http.get("/v1/jobs/"), 404, "not_found")
    answer = api.http.put("/v1/jobs")
    check_problem(answer, 405, "method_not_allowed")
    assert answer.headers["allow"] == "GET, POST"
    assert api.http.put("/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6").headers["allow"] == "DELETE, GET"


def test_health_and_readiness(api: Api, openapi: dict[str, Any]) -> None:
    health = api.http.get("/healthz")
    assert health.status_code == 200
    check_document(health.json(), "Health", openapi)
    ready = api.http.get("/readyz")
    check_document(ready.json(), "Readiness", openapi)
    assert ready.status_code == 200
    assert {part["status"] for name, part in ready.json().items() if name != "status"} == {"ok"}


def test_the_pages_load_nothing_from_another_host(api: Api, openapi: dict[str, Any]) -> None:
    assert api.http.get("/openapi.json").json() == openapi
    page = api.http.get("/docs")
    assert page.headers["content-type"].startswith("text/html")
    assert not re.search(r"<script|<link|src=|@import|url\(", page.text)
    for path in openapi["paths"]:
        assert path in page.text
    assert api.http.get("/redoc").status_code == 404


def test_nobody_elses_page_may_call_the_api(api: Api) -> None:
    answer = api.http.get("/healthz", headers={"Origin": "https://elsewhere.example"})
    assert not [name for name in answer.headers if name.startswith("access-control-")]


def test_many_ask_at_once(api: Api) -> None:
    job = new_job(api.record)
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: api.http.get(f"/v1/jobs/{job.id}").status_code, range(80)))
    assert set(answers) == {200}


def test_a_mistake_of_ours_is_a_problem_without_its_details(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    def mistake(*_: object) -> None:
        raise RuntimeError("the password is 1234")

    monkeypatch.setattr("meshdeform.jobs.record.JobRecord.list_jobs", mistake)
    answer = api.http.get("/v1/jobs")
    check_problem(answer, 500, "internal")
    assert "1234" not in answer.text


def test_without_redis_jobs_are_accepted_and_told_later(
    database_url: str, redis_server_url: str, tmp_path: Path, sphere: bytes
) -> None:
    """And `/readyz` says which part is missing."""
    settings = Settings(
        data_dir=tmp_path, database_url=database_url, redis_url=f"redis://127.0.0.1:{free_port()}/0", queue="away"
    )
    record = JobRecord(database_url)
    with serving(settings) as url, httpx.Client(base_url=url, timeout=30) as http:
        lost = Api(url, settings, record, ObjectStore(settings.resolved_storage_url), http)
        answer = post(lost, sphere)
        assert answer.status_code == 202, answer.text
        ready = http.get("/readyz")
        assert ready.status_code == 503
        assert ready.json()["redis"]["status"] == "unavailable"
        assert ready.json()["record"]["status"] == ready.json()["store"]["status"] == "ok"
        assert http.get("/healthz").status_code == 200
    queue = JobQueue(redis_server_url, "back-again")
    assert answer.json()["id"] in Reconciler(record, queue, 3).run_once()
    assert answer.json()["id"] in queue.told()
    queue.close()
    record.close()


def test_a_store_that_is_away_refuses_and_leaves_no_job(
    api: Api, sphere: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(*_: object, **__: object) -> None:
        raise UnavailableError("The object store does not answer.")

    monkeypatch.setattr("meshdeform.storage.ObjectStore.exists", lambda *_: False)
    monkeypatch.setattr("meshdeform.storage.ObjectStore.put", away)
    before = api.record.list_jobs(limit=1).jobs
    answer = post(api, sphere)
    check_problem(answer, 503, "unavailable")
    assert int(answer.headers["retry-after"]) >= 1
    assert api.record.list_jobs(limit=1).jobs == before


def test_a_job_stays_readable_whatever_it_holds(api: Api, openapi: dict[str, Any]) -> None:
    request = JobRequest(prompt="a vase", metadata={"ключ": "\u0000\ud7ff</script>"})
    job = api.record.create(request, stored_file("a", "größe 1.glb"))
    document = api.http.get(f"/v1/jobs/{job.id}").json()
    check_document(document, "JobView", openapi)
    assert document["metadata"] == request.metadata
    assert document["asset"]["filename"] == "größe 1.glb"
