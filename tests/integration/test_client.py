"""The client against the real server."""

from __future__ import annotations

import hashlib
import math
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from meshdeform.api.jobs import JobView
from meshdeform.client import Client, UploadProgress
from meshdeform.client.sync import transfers
from meshdeform.errors import (
    AssetFormatError,
    ConflictError,
    JobNotFinishedError,
    NotFoundError,
    NumericalError,
    ParameterError,
    VocabularyError,
)
from meshdeform.record.models import JobError, JobState, Progress
from meshdeform.requests.document import DeformParams, OutputParams
from tests.claims import claim_job
from tests.client_flavors import both_clients, opened
from tests.integration.conftest import DEADLINE_S, Api, new_job, stored_result

CONTENT = bytes(range(256)) * 4096


@pytest.fixture
def client(api: Api, request: pytest.FixtureRequest) -> Iterator[Client]:
    with opened(getattr(request, "param", "sync"), api.url) as made:
        yield made


@pytest.fixture
def sphere(repository: Path) -> Path:
    return repository / "examples" / "sphere.glb"


def publish(api: Api, job_id: str, content: bytes = CONTENT) -> None:
    """Do what a worker does at the end."""
    made = stored_result(api.store, f"jobs/{job_id}/1/result.glb", content)
    api.record.leases.finish(job_id, 1, JobState.SUCCEEDED, results=[made])


def answering(*answers: Any, max_retries: int = 0) -> Client:
    """A client whose service answers from a list."""
    left = list(answers)

    def handle(request: httpx.Request) -> httpx.Response:
        answer = left.pop(0)
        if callable(answer):
            answer = answer(request)
        assert isinstance(answer, httpx.Response)
        return answer

    return Client("http://x", max_retries=max_retries, http=httpx.Client(transport=httpx.MockTransport(handle)))


@both_clients
def test_from_a_file_to_a_file(api: Api, client: Client, sphere: Path, tmp_path: Path) -> None:
    params = DeformParams.model_validate({"preset": "preview", "seed": 7, "guidance": {"kind": "sds"}})
    job = client.submit(sphere, "a mushroom", params=params, output=OutputParams(morph=True), metadata={"a": "b"})
    assert (job.state, job.prompt, job.asset.filename) == (JobState.QUEUED, "a mushroom", "sphere.glb")
    assert job.params == params
    assert job.params.model_fields_set == {"preset", "seed", "guidance"}
    assert (job.output.morph, job.metadata) == (True, {"a": "b"})
    assert claim_job(api.record.leases, job.id, "worker", 60.0)
    seen: list[JobView] = []

    def work() -> None:
        progress = Progress(step=1, total_steps=2, fraction=0.5, phase="optimizing", attempt=1)
        api.record.leases.save_progress(job.id, 1, progress)
        publish(api, job.id)

    worker = threading.Thread(target=work)

    def on_change(changed: JobView) -> None:
        seen.append(changed)
        if len(seen) == 1:
            worker.start()

    done = client.wait(job.id, timeout_s=DEADLINE_S, on_change=on_change)
    worker.join()
    assert done == seen[-1] == client.get(job.id)
    assert (seen[0].state, done.state, done.progress.fraction) == (JobState.RUNNING, JobState.SUCCEEDED, 1.0)
    (artifact,) = client.artifacts(job.id)
    target = tmp_path / "mushroom.glb"
    target.write_bytes(b"before")
    assert client.download(job.id, artifact.name, target) == target
    assert target.read_bytes() == CONTENT
    assert [path.name for path in tmp_path.iterdir()] == ["mushroom.glb"]
    client.delete(job.id)
    with pytest.raises(NotFoundError):
        client.get(job.id)


def test_jobs_are_listed_through_all_pages(api: Api, client: Client) -> None:
    made = [new_job(api.record).id for _ in range(5)]
    listed = [job.id for job in client.jobs(limit=2)]
    assert listed[:5] == made[::-1]
    assert len(listed) == len(set(listed))
    client.cancel(made[0])
    assert made[0] in [job.id for job in client.jobs(state="canceled")]


@both_clients
def test_problems_are_the_errors_that_they_were(api: Api, client: Client, sphere: Path, tmp_path: Path) -> None:
    with pytest.raises(VocabularyError) as unknown:
        client.submit(sphere, "a quixotic zeitgeist")
    assert "mushroom" in unknown.value.extra["nouns"]
    with pytest.raises(ParameterError) as wrong:
        client.submit(sphere, "a mushroom", params={"stepz": 1})
    assert wrong.value.extra["errors"][0]["loc"] == ["params", "stepz"]
    other = tmp_path / "notes.txt"
    other.write_text("no mesh")
    with pytest.raises(AssetFormatError) as format_:
        client.submit(other, "a mushroom")
    assert format_.value.advice_text
    job = new_job(api.record)
    with pytest.raises(ConflictError) as conflict:
        client.delete(job.id)
    assert conflict.value.extra["state"] == "queued"
    with pytest.raises(JobNotFinishedError):
        client.download(job.id, "result.glb", tmp_path / "x.glb")
    assert not (tmp_path / "x.glb").exists()


@both_clients
def test_waiting_raises_what_the_job_failed_with(api: Api, client: Client) -> None:
    job = new_job(api.record)
    claim_job(api.record.leases, job.id, "worker", 60.0)
    api.record.leases.finish(job.id, 1, JobState.FAILED, JobError.of(NumericalError("A loss is NaN.")))
    with pytest.raises(NumericalError, match="A loss is NaN") as caught:
        client.wait(job.id)
    assert caught.value.extra == {"job_id": job.id}
    assert client.wait(job.id, check=False).state is JobState.FAILED
    canceled = new_job(api.record)
    client.cancel(canceled.id)
    with pytest.raises(ConflictError, match="canceled"):
        client.wait(canceled.id)


def test_waiting_keeps_the_services_pace_and_sends_the_tag(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    monkeypatch.setattr(time, "sleep", pauses.append)
    job = JobView.of(new_job(api.record))
    done = job.model_copy(update={"state": JobState.SUCCEEDED})
    sent: list[str | None] = []

    def answer(status: int, view: JobView | None, headers: dict[str, str]) -> Any:
        def handle(request: httpx.Request) -> httpx.Response:
            sent.append(request.headers.get("If-None-Match"))
            return httpx.Response(status, json=view.as_json() if view else None, headers=headers)

        return handle

    client = answering(
        answer(200, job, {"ETag": 'W/"1"', "Retry-After": "3"}),
        answer(304, None, {"ETag": 'W/"1"', "Retry-After": "0"}),
        answer(304, None, {"Retry-After": "soon"}),
        answer(304, None, {"Retry-After": "9999"}),
        answer(200, done, {"ETag": 'W/"2"'}),
    )
    assert client.wait(job.id).state is JobState.SUCCEEDED
    assert pauses == [3.0, 0.05, 1.0, 30.0]
    assert sent == [None, *['W/"1"'] * 4]


class _BreaksOff(httpx.SyncByteStream):
    def __init__(self, data: bytes) -> None:
        self._data = data

    def __iter__(self) -> Iterator[bytes]:
        yield self._data
        raise httpx.ReadError("cut off")


def test_a_file_that_changed_meanwhile_is_taken_from_its_beginning(tmp_path: Path) -> None:
    tags = [f'"{hashlib.sha256(data).hexdigest()}"' for data in (b"old" * 9, b"new")]
    client = answering(
        httpx.Response(200, headers={"ETag": tags[0]}, stream=_BreaksOff(b"old")),
        httpx.Response(200, headers={"ETag": tags[1]}, stream=httpx.ByteStream(b"new")),
        max_retries=1,
    )
    client.download("x", "result.glb", tmp_path / "a.glb")
    assert (tmp_path / "a.glb").read_bytes() == b"new"


def test_a_file_is_sent_once_and_its_progress_is_told(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transfers, "_PIECE_S", math.inf)  # however busy this machine is
    data, sent, told = os.urandom(300 * 1024), list[str](), list[UploadProgress]()

    def upload(filename: str = "big.glb") -> str:
        hooks = {"request": [lambda request: sent.append(request.method)]}
        with (
            httpx.Client(base_url=api.url, event_hooks=hooks, timeout=240) as http,
            Client(http=http, on_upload=told.append) as client,
        ):
            return client.upload(data, filename=filename).id

    first = upload()
    assert [progress.sent for progress in told] == [0, 64 << 10, 192 << 10, 300 << 10]
    assert told[-1] == UploadProgress("big.glb", len(data), len(data))
    assert sent.count("PUT") == 3
    sent.clear()
    told.clear()
    assert upload() == first, "another client, as of another process"
    assert (sent.count("PUT"), told) == (0, [])
    assert upload("other.glb") != first
    # What the service has deleted since is sent again.
    api.http.delete(f"/v1/uploads/{first}").raise_for_status()
    sent.clear()
    assert upload() != first
    assert sent.count("PUT") == 3
