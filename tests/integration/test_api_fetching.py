"""Assets that the request holds as base64, or names by a URL, over real sockets."""

from __future__ import annotations

import base64
import hashlib
import threading
import uuid
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import httpx
import pytest
import sqlalchemy as sa

from meshdeform.api.limits import MAX_DOCUMENT_BYTES
from meshdeform.errors import AssetNotFetchedError, UnavailableError
from meshdeform.record.fetching import Fetching
from meshdeform.record.models import JobError, JobState, NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import jobs
from meshdeform.requests.document import JobRequest
from meshdeform.settings import Settings
from service.jobs import arrivals, creation_routes
from tests.acceptance.service import until
from tests.cases import each_case
from tests.claims import claim_job
from tests.integration.conftest import DEADLINE_S, Api, serving, serving_api
from tests.integration.http_calls import PROMPT, check_document, check_problem, post


class _Files(BaseHTTPRequestHandler):
    """Answers with the sphere, or in another way that the path names."""

    sphere = b""
    calls: ClassVar[list[str]] = []
    late = threading.Event()

    def do_GET(self) -> None:
        self.calls.append(self.path)
        name = self.path.split("?")[0]
        if name == "/moved":
            return self._answer(302, b"", Location="/sphere.glb")
        if name == "/missing":
            return self._answer(404, self.sphere)
        if name == "/packed":
            return self._answer(200, self.sphere, **{"Content-Encoding": "gzip"})
        if name == "/cut":
            return self._answer(200, self.sphere[:100], **{"Content-Length": str(len(self.sphere))})
        if name == "/large":
            return self._answer(200, bytes(2**20 + 1))
        if name in ("/slow", "/drip"):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"g" if name == "/drip" else b"")
            self.server.stopped.wait(DEADLINE_S)  # type: ignore[attr-defined]
            return None
        if name.startswith("/late"):
            self.late.wait(DEADLINE_S)
            return self._answer(404 if "missing" in name else 200, b"glTF" if "torn" in name else self.sphere)
        return self._answer(200, self.sphere)

    def _answer(self, status: int, body: bytes, **headers: str) -> None:
        self.send_response(status)
        for header, value in {"Content-Length": str(len(body)), **headers}.items():
            self.send_header(header, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def files(sphere: bytes) -> Iterator[str]:
    """The address of a server of files on loopback."""
    _Files.sphere = sphere
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Files)
    server.stopped = threading.Event()  # type: ignore[attr-defined]
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.stopped.set()  # type: ignore[attr-defined]
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def fetching(own_settings: Callable[..., Settings]) -> Iterator[Api]:
    """An API that may fetch from loopback."""
    with serving_api(own_settings(max_upload_bytes=2**20, fetch_networks=["127.0.0.0/8"])) as found:
        yield found


def test_a_url_is_fetched_and_the_job_has_the_file(
    fetching: Api, files: str, sphere: bytes, openapi: dict[str, Any]
) -> None:
    document = {**PROMPT, "asset": {"url": f"{files}/models/my%20sphere.glb?key=secret"}}
    answer = fetching.http.post("/v1/jobs", json=document)
    assert answer.status_code == 202, answer.text
    job = answer.json()
    check_document(job, "JobView", openapi)
    digest = hashlib.sha256(sphere).hexdigest()
    assert job["asset"] == {"filename": "my sphere.glb", "size": len(sphere), "sha256": digest}
    assert fetching.store.get(f"assets/{digest}") == sphere
    assert "secret" not in fetching.http.get(f"/v1/jobs/{job['id']}").text
    found = fetching.http.post("/v1/jobs:validate", json=document).json()
    assert found["asset"]["sha256"] == digest


def test_an_asset_in_the_document_is_the_same_request_as_one_beside_it(fetching: Api, sphere: bytes) -> None:
    text = base64.b64encode(sphere).decode()
    assert len(text) < MAX_DOCUMENT_BYTES
    key = {"Idempotency-Key": uuid.uuid4().hex}
    document = {**PROMPT, "asset": {"data": text, "filename": "sphere.glb"}}
    first = fetching.http.post("/v1/jobs", json=document, headers=key)
    assert first.status_code == 202, first.text
    for same in (text, f"data:model/gltf-binary;base64,{text}", f"{text[:40]}\n{text[40:]}"):
        again = fetching.http.post("/v1/jobs", json={**PROMPT, "files": {"asset": {"data": same}}}, headers=key)
        assert (again.json()["id"], again.headers["idempotency-replayed"]) == (first.json()["id"], "true")
    other = {**PROMPT, "asset": {"data": base64.b64encode(sphere + b"\0\0\0\0").decode()}}
    check_problem(fetching.http.post("/v1/jobs", json=other, headers=key), 422, "idempotency_mismatch")


def test_the_key_covers_a_url_and_not_what_is_behind_it(fetching: Api, files: str, sphere: bytes) -> None:
    key = {"Idempotency-Key": uuid.uuid4().hex}
    document = {**PROMPT, "asset": {"url": f"{files}/sphere.glb"}}
    first = fetching.http.post("/v1/jobs", json=document, headers=key)
    try:
        _Files.sphere = b""
        assert fetching.http.post("/v1/jobs", json=document, headers=key).json() == first.json()
    finally:
        _Files.sphere = sphere
    other = {**PROMPT, "asset": {"url": f"{files}/sphere.glb?other"}}
    check_problem(fetching.http.post("/v1/jobs", json=other, headers=key), 422, "idempotency_mismatch")


def test_a_long_document_may_hold_a_file_and_nothing_else(fetching: Api, sphere: bytes) -> None:
    long = sphere + bytes(-len(sphere) % 4) + bytes(300_000)
    answer = fetching.http.post("/v1/jobs", json={**PROMPT, "asset": {"data": base64.b64encode(long).decode()}})
    check_problem(answer, 422, "asset_invalid")  # it was decoded, and has bytes after its end
    labels = {f"label{k}": "x" * 200 for k in range(2000)}
    for document in ({**PROMPT, "metadata": labels}, {**PROMPT, "metadata": labels, "asset": {"data": "AAAA"}}):
        assert fetching.http.post("/v1/jobs", json=document).status_code == 422
    answer = fetching.http.post("/v1/jobs", json={**PROMPT, "asset": {"data": "A" * 2**20}})
    assert "longer than 1 MiB" in check_problem(answer, 422, "request_invalid")["detail"]


@each_case(
    ("path", "words"),
    [
        ("/moved", "answered 302; redirects are not followed"),
        ("/missing", "answered 404"),
        ("/packed", "compressed body"),
        ("/cut", "cut off"),
        ("/slow", "did not arrive within 0.3 s"),
        ("/drip", "After 0.3 s the file came at less than 32768 bytes per second"),
    ],
)
def test_what_a_host_does_not_send_is_said(
    path: str, words: str, fetching: Api, files: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrivals, "MAX_FETCH_S", 0.3 if path == "/slow" else 30.0)
    monkeypatch.setattr(arrivals, "_SLOW_AFTER_S", 0.3 if path == "/drip" else 10.0)
    answer = fetching.http.post("/v1/jobs", json={**PROMPT, "asset": {"url": files + path}})
    assert words in check_problem(answer, 422, "asset_not_fetched")["detail"]


def test_a_file_behind_a_url_has_the_limit_of_uploads(fetching: Api, files: str) -> None:
    answer = fetching.http.post("/v1/jobs", json={**PROMPT, "asset": {"url": f"{files}/large"}})
    check_problem(answer, 413, "asset_too_large")


@each_case(
    "url",
    [
        "http://127.0.0.1:{port}/sphere.glb",
        "https://127.0.0.1:{port}/sphere.glb",
        "https://169.254.169.254/latest/meta-data",
        "https://user:password@93.184.216.34/a.glb",
        "file:///etc/passwd",
        "sphere.glb",
    ],
)
def test_only_the_public_internet_is_asked(url: str, api: Api, files: str) -> None:
    before = len(_Files.calls)
    document = {**PROMPT, "asset": {"url": url.format(port=files.rpartition(":")[2])}}
    check_problem(api.http.post("/v1/jobs", json=document), 422, "asset_not_fetched")
    assert len(_Files.calls) == before


def test_fetching_can_be_turned_off(redis_server_url: str, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, redis_url=redis_server_url, fetch_assets=False)
    with serving(settings) as url:
        answer = httpx.post(f"{url}/v1/jobs", json={**PROMPT, "asset": {"url": "https://example.org/sphere.glb"}})
    assert "MESHDEFORM_FETCH_ASSETS" in check_problem(answer, 422, "asset_not_fetched")["detail"]


@each_case(
    ("asset", "place"),
    [
        ({"data": "####"}, ["asset", "data"]),
        ({"data": "AAA"}, ["asset", "data"]),
        ({"data": "AAAA", "url": "https://example.org/a.glb"}, ["asset"]),
        ({"url": "https://example.org/a.glb", "artifact": "result.glb"}, ["asset"]),
        ({"filename": "a.glb"}, ["asset"]),
    ],
)
def test_a_wrong_reference_is_named(asset: dict[str, str], place: list[str], fetching: Api) -> None:
    problem = check_problem(fetching.http.post("/v1/jobs", json={**PROMPT, "asset": asset}), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == place


def test_a_file_is_given_once(fetching: Api, sphere: bytes) -> None:
    answer = post(fetching, sphere, {**PROMPT, "asset": {"data": base64.b64encode(sphere).decode()}})
    assert "both sent" in check_problem(answer, 422, "parameter_invalid")["detail"]
    with_target = {"params": {"guidance": {"kind": "target"}}, "target": {"data": base64.b64encode(sphere).decode()}}
    answer = post(fetching, sphere, with_target)
    assert set(fetching.record.get(answer.json()["id"]).files) == {"asset", "target"}


# What is not there soon


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Jobs are accepted early after a moment; the host answers once `_Files.late` is set."""
    monkeypatch.setattr(creation_routes, "FETCH_SOON_S", 0.1)
    _Files.late.clear()
    yield
    _Files.late.set()


def early(api: Api, url: str, **more: Any) -> str:
    """Send a job whose asset is at a URL of a slow host, and return its id."""
    answer = api.http.post("/v1/jobs", json={**PROMPT, "asset": {"url": url}, **more})
    assert answer.status_code == 202, answer.text
    job = answer.json()
    assert (job["state"], job["progress"]["phase"], job["files"], job["retry_at"]) == ("queued", "fetching", {}, None)
    return str(job["id"])


def claim(api: Api, job_id: str) -> Any:
    return claim_job(api.record.leases, job_id, "w", 60.0)


@pytest.mark.usefixtures("soon")
def test_a_job_is_accepted_before_a_slow_host_has_sent_its_file(
    fetching: Api, files: str, sphere: bytes, openapi: dict[str, Any]
) -> None:
    key = {"Idempotency-Key": uuid.uuid4().hex}
    document = {**PROMPT, "asset": {"url": f"{files}/late"}, "metadata": {"a": "b"}}
    first = fetching.http.post("/v1/jobs", json=document, headers=key)
    job_id = first.json()["id"]
    check_document(first.json(), "JobView", openapi)
    assert fetching.http.post("/v1/jobs", json=document, headers=key).json() == first.json()
    claimed_early = fetching.record.leases.claim_next("w", 60.0)
    assert claimed_early is None or claimed_early.id != job_id
    _Files.late.set()
    until("its file is there", lambda: fetching.record.get(job_id).progress.phase == "queued")
    job = fetching.record.get(job_id)
    assert (job.source.filename, job.source.size) == ("late", len(sphere))
    assert fetching.store.get(job.source.key) == sphere
    assert [event.data["reason"] for event in fetching.record.events.after(job_id)] == ["created", "fetched"]
    assert [found.id for found in fetching.record.list_jobs(words="late mushroom").jobs] == [job_id]
    assert claim(fetching, job_id).files == job.files


@pytest.mark.usefixtures("soon")
@each_case(("path", "code"), [("/late/missing", "asset_not_fetched"), ("/late/torn.glb", "asset_truncated")])
def test_a_job_fails_by_what_comes_later(path: str, code: str, fetching: Api, files: str) -> None:
    _Files.late.clear()
    job_id = early(fetching, files + path)
    _Files.late.set()
    until("it is over", lambda: fetching.record.get(job_id).state.terminal)
    job = fetching.record.get(job_id)
    assert job.error is not None
    assert (job.state, job.error.code, job.attempt) == (JobState.FAILED, code, 0)
    check_problem(fetching.http.post(f"/v1/jobs/{job_id}/retry"), 409, "conflict")


@pytest.mark.usefixtures("soon")
def test_what_was_sent_is_checked_before_the_answer(fetching: Api, files: str, sphere: bytes) -> None:
    late = {"url": f"{files}/late"}
    answer = fetching.http.post("/v1/jobs", json={**PROMPT, "asset": late, "params": {"seed": -1}})
    check_problem(answer, 422, "parameter_invalid")
    target = base64.b64encode(b"no mesh").decode()
    to_target = {"params": {"guidance": {"kind": "target"}}, "asset": late, "target": {"data": target}}
    assert fetching.http.post("/v1/jobs", json=to_target).status_code in (415, 422)


@pytest.mark.usefixtures("soon")
def test_a_job_that_is_canceled_while_its_file_is_fetched_stays_so(fetching: Api, files: str) -> None:
    job_id = early(fetching, f"{files}/late")
    assert fetching.http.post(f"/v1/jobs/{job_id}/cancel").json()["state"] == "canceled"
    assert fetching.record.fetching.complete(job_id, NewJob(JobRequest(prompt="a vase"), {})) is None
    fetching.record.fetching.fail(job_id, JobError.of(AssetNotFetchedError("The host is gone.")))
    assert [event.type for event in fetching.record.events.after(job_id)] == ["queued", "canceled"]


def away_once(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str) -> list[str]:
    """Let the first call of a function for each job meet an outage; return a list that has the job of each call."""
    calls, function = list[str](), getattr(owner, name)

    def called(*arguments: Any) -> Any:
        calls.append(next(each for each in arguments if isinstance(each, str)))
        if calls.count(calls[-1]) == 1:
            raise UnavailableError("The record does not answer.")
        return function(*arguments)

    monkeypatch.setattr(owner, name, called)
    return calls


@pytest.mark.usefixtures("soon")
@each_case(("path", "state"), [("/late", JobState.QUEUED), ("/late/missing", JobState.FAILED)])
def test_an_outage_while_a_job_is_completed_or_fails_is_waited_for(
    path: str, state: JobState, fetching: Api, files: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    _Files.late.clear()
    with monkeypatch.context() as patched:
        patched.setattr(arrivals, "_AGAIN_S", 0.01)
        completed = away_once(patched, arrivals, "complete_job")
        failed = away_once(patched, Fetching, "fail")
        job_id = early(fetching, files + path)
        _Files.late.set()
        until("it is decided", lambda: fetching.record.get(job_id).progress.phase != "fetching")
    assert fetching.record.get(job_id).state is state
    assert [completed.count(job_id), failed.count(job_id)] == ([2, 0] if state is JobState.QUEUED else [0, 2])


@pytest.mark.usefixtures("soon")
def test_who_sends_bytes_does_not_wait_for_slow_hosts(fetching: Api, files: str, sphere: bytes) -> None:
    held = [early(fetching, f"{files}/late") for _ in range(12)]
    assert post(fetching, sphere, PROMPT).status_code == 202
    _Files.late.set()
    for job_id in held:
        until("it has its file", lambda job_id=job_id: fetching.record.get(job_id).files)


@pytest.mark.usefixtures("soon")
def test_a_server_that_stops_lets_jobs_fail_whose_files_it_fetches(
    record: JobRecord, files: str, tmp_path: Path, redis_url: str, database_url: str
) -> None:
    settings = Settings(
        data_dir=tmp_path, redis_url=redis_url, database_url=database_url, fetch_networks=["127.0.0.0/8"]
    )
    with serving_api(settings) as api:
        job_id = early(api, f"{files}/late")
    job = record.get(job_id)
    assert job.error is not None
    assert (job.state, job.error.code) == (JobState.FAILED, "asset_not_fetched")
    assert "stopped" in job.error.detail


def test_a_job_whose_server_has_died_fails(record: JobRecord) -> None:
    left = record.create(NewJob(JobRequest(prompt="a mushroom"), {}, fetching=True))
    record.fetching.fail_abandoned()
    assert record.get(left.id).state is JobState.QUEUED
    with record.database.write() as connection:
        connection.execute(sa.update(jobs).values(created_at=record.database.now(-3600)))
    record.fetching.fail_abandoned()
    job = record.get(left.id)
    assert job.error is not None
    assert (job.state, job.error.code, job.retry_at) == (JobState.FAILED, "asset_not_fetched", None)
