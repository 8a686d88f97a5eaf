"""Files on their way there and back: what is sent, to whom, what is compared, and what is refused."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import math
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anyio
import httpx
import pytest

from meshdeform.client import AsyncClient, Client, JobView, Result, UploadView
from meshdeform.client.orders import LocalFile, Order, open_source
from meshdeform.client.retries import Policy
from meshdeform.errors import ChecksumError, MeshdeformError, NotFoundError, UnavailableError
from tests.cases import each_case
from tests.unit.client.test_documents import JOB

KEY = "md_secret"
DATA = bytes(range(256)) * 3000
SHA = hashlib.sha256(DATA).hexdigest()
UPLOAD = {
    "id": "upl_1",
    "filename": "asset.glb",
    "size": len(DATA),
    "state": "open",
    "offset": 0,
    "created_at": "2026-01-31T12:00:00Z",
    "expires_at": "2026-01-31T12:00:00Z",
    "method": "PUT",
    "url": "https://bucket.example/there?signature=1",
    "headers": {"x-ms-blob-type": "BlockBlob"},
}


class Service:
    """Answers by method and path, and remembers what came."""

    def __init__(self, **routes: Any) -> None:
        self.routes = {name.replace("_", " ", 1): list(answers) for name, answers in routes.items()}
        self.requests: list[tuple[httpx.Request, bytes]] = []

    def handle(self, request: httpx.Request) -> httpx.Response:
        self.requests.append((request, request.read()))
        return self._answer(request)

    async def handle_async(self, request: httpx.Request) -> httpx.Response:
        self.requests.append((request, await request.aread()))
        return self._answer(request)

    def _answer(self, request: httpx.Request) -> httpx.Response:
        name = f"{request.method} {request.url.path.removeprefix('/v1').strip('/').replace('/', '_')}"
        answers = self.routes.get(name)
        if not answers:
            return httpx.Response(404, json={"code": "not_found", "detail": name, "advice": ""})
        found = answers.pop(0) if len(answers) > 1 else answers[0]
        return found if isinstance(found, httpx.Response) else httpx.Response(200, json=found)

    def client(self, **options: Any) -> Client:
        return Client(api_key=KEY, http=httpx.Client(transport=httpx.MockTransport(self.handle)), **options)

    def sent(self, method: str, path: str) -> list[tuple[httpx.Request, bytes]]:
        return [each for each in self.requests if (each[0].method, each[0].url.path) == (method, path)]


def job(sha256: str = SHA, **more: Any) -> dict[str, Any]:
    asset = {"filename": "asset.glb", "size": len(DATA), "sha256": sha256}
    return {**JOB, "asset": asset, "files": {"asset": asset}, **more}


def problem(status: int, code: str) -> httpx.Response:
    return httpx.Response(status, json={"code": code, "detail": "d", "advice": "a"})


# There


@each_case("flavor", ["sync", "async"])
def test_a_bucket_gets_the_bytes_and_not_the_key(flavor: str) -> None:
    service = Service(
        POST_uploads=[UPLOAD],
        POST_uploads_upl_1_complete=[{**UPLOAD, "state": "complete"}],
        POST_jobs=[job()],
    )
    service.routes["PUT there"] = [httpx.Response(503, headers={"Retry-After": "0"}), httpx.Response(200)]
    if flavor == "sync":
        with service.client() as client:
            client.submit(DATA, "a mushroom", upload=True)
    else:

        async def main() -> None:
            transport = httpx.MockTransport(service.handle_async)
            http = httpx.AsyncClient(transport=transport, auth=("me", "secret"), headers={"X-Mine": "secret"})
            async with http, AsyncClient(api_key=KEY, http=http) as client:
                await client.submit(DATA, "a mushroom", upload=True)

        anyio.run(main)
    puts = service.sent("PUT", "/there")
    assert len(puts) == 2
    for request, body in puts:
        assert body == DATA
        assert request.url.host == "bucket.example"
        assert {"authorization", "x-mine"} & set(request.headers) == set()
        assert request.headers["x-ms-blob-type"] == "BlockBlob"
        assert request.headers["Host"] == "bucket.example"
        assert request.headers["Content-Length"] == str(len(DATA))
        assert "Transfer-Encoding" not in request.headers
    ((posted, document),) = service.sent("POST", "/v1/jobs")
    assert json.loads(document) == {"prompt": "a mushroom", "files": {"asset": {"upload_id": "upl_1"}}}
    assert posted.headers["Authorization"] == (f"Bearer {KEY}" if flavor == "sync" else "Basic bWU6c2VjcmV0")
    assert posted.headers["Idempotency-Key"]


def test_a_service_without_uploads_gets_a_form() -> None:
    service = Service(POST_jobs=[job()])
    with service.client() as client:
        client._connection.policy = Policy(upload_above=1000)
        client.submit(DATA, "a mushroom")
        with pytest.raises(NotFoundError):
            client.submit(DATA, "a mushroom", upload=True)
    ((request, body),) = service.sent("POST", "/v1/jobs")
    assert request.headers["Content-Type"].startswith("multipart/form-data")
    assert DATA in body


def test_every_request_has_a_key_of_its_own_and_keeps_it() -> None:
    service = Service(POST_jobs=[problem(503, "unavailable"), job(), job(), job()])
    with service.client() as client:
        for key in (None, None, "mine"):
            client.submit(DATA, idempotency_key=key)
    first, second, third, fourth = (
        request.headers["Idempotency-Key"] for request, _ in service.sent("POST", "/v1/jobs")
    )
    assert first == second != third
    assert fourth == "mine"


def test_what_arrived_otherwise_is_canceled() -> None:
    service = Service(POST_jobs=[job("0" * 64)], POST_jobs_job_1_cancel=[job("0" * 64)])
    with service.client() as client, pytest.raises(ChecksumError, match="job_1 is canceled"):
        client.submit(DATA)
    assert len(service.sent("POST", "/v1/jobs/job_1/cancel")) == 1


def measured(asset: Any, filename: str | None = None) -> tuple[str, int, str]:
    with contextlib.ExitStack() as files:
        source = open_source(asset, files, filename)
        assert isinstance(source, LocalFile)
        assert source.file.read() == DATA
        return source.filename, source.size, source.sha256


def test_an_asset_may_come_from_anywhere(tmp_path: Path) -> None:
    path = tmp_path / "knight.obj"
    path.write_bytes(DATA)
    assert measured(path) == measured(str(path)) == ("knight.obj", len(DATA), SHA)
    assert measured(DATA) == measured(bytearray(DATA)) == ("asset.glb", len(DATA), SHA)
    assert measured(DATA, "a.ply") == ("a.ply", len(DATA), SHA)
    with path.open("rb") as file:
        assert measured(file) == ("knight.obj", len(DATA), SHA)
    behind = io.BytesIO(b"head" + DATA)
    behind.seek(4)
    assert measured(behind)[1:] == (len(DATA), SHA)
    assert not behind.closed
    reading, writing = os.pipe()

    def write() -> None:
        with os.fdopen(writing, "wb") as sink:
            sink.write(DATA)

    writer = threading.Thread(target=write)
    writer.start()
    with os.fdopen(reading, "rb") as pipe:  # cannot be read twice
        assert measured(pipe) == ("asset.glb", len(DATA), SHA)
    writer.join()
    with contextlib.ExitStack() as files:
        assert open_source(UploadView(**UPLOAD), files) == {"upload_id": "upl_1"}
        assert open_source({"job_id": "job_1"}, files) == {"job_id": "job_1"}
        with pytest.raises(TypeError, match="not int"):
            open_source(7, files)  # type: ignore[arg-type]
        with pytest.raises(FileNotFoundError):
            open_source(tmp_path / "none.glb", files)


def test_what_is_no_json_is_refused_before_it_is_sent() -> None:
    with pytest.raises(ValueError, match="JSON"):
        Order(params={"seed": math.nan}).document()
    with pytest.raises(TypeError, match="not a JSON value"):
        Order(params={"seed": object()}).document()
    assert Order("x", params={"guidance": {"model": Path("a")}}).document() == {
        "prompt": "x",
        "params": {"guidance": {"model": "a"}},
    }


def test_a_misspelled_option_is_refused_by_its_name() -> None:
    with Client("http://127.0.0.1:1") as client, pytest.raises(TypeError, match="'metadta'"):
        client.submit(DATA, "x", metadta={"shot": "a"})  # type: ignore[call-arg]


# Back


def artifact(name: str, **more: Any) -> dict[str, Any]:
    known = {"name": name, "content_type": "x/y", "size": len(DATA), "sha256": SHA, "href": "/", **more}
    return {**known, "created_at": "2026-01-31T12:00:00Z"}


@each_case("name", ["../up.glb", "/etc/x", "a/b", "..", ".", "a\\b", ""])
def test_a_name_that_leads_elsewhere_is_no_file_name(name: str, tmp_path: Path) -> None:
    service = Service(GET_jobs_job_1_artifacts=[{"artifacts": [artifact(name)]}])
    with service.client() as client, pytest.raises(UnavailableError, match="not a file name"):
        client.fetch("job_1", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_bytes_of_another_artifact_are_refused(tmp_path: Path) -> None:
    service = Service(
        GET_jobs_job_1_artifacts=[{"artifacts": [artifact("a.glb")]}],
        **{"GET_jobs_job_1_artifacts_a.glb": [httpx.Response(200, stream=httpx.ByteStream(b"other"))]},
    )
    with service.client() as client, pytest.raises(UnavailableError, match="differ from"):
        client.fetch("job_1", tmp_path)
    assert list(tmp_path.iterdir()) == []


class _Broken(httpx.SyncByteStream):
    def __iter__(self) -> Any:
        yield DATA[:1000]
        raise httpx.ReadError("cut")


@each_case(
    "again", [lambda: httpx.Response(200, stream=httpx.ByteStream(DATA)), lambda: problem(416, "range_not_satisfiable")]
)
def test_a_file_without_a_tag_is_taken_from_its_beginning(again: Callable[[], httpx.Response]) -> None:
    whole = httpx.Response(200, stream=httpx.ByteStream(DATA))
    service = Service(**{"GET_jobs_job_1_artifacts_a.glb": [httpx.Response(200, stream=_Broken()), again(), whole]})
    with service.client() as client:
        assert client.read("job_1", "a.glb") == DATA
    assert all("Range" not in request.headers for request, _ in service.requests)


def test_a_result_is_shown_as_it_is_and_got_once() -> None:
    png = b"\x89PNG..."
    service = Service(
        **{
            "GET_jobs_job_1_artifacts_preview.png": [httpx.Response(200, stream=httpx.ByteStream(png))],
            "GET_jobs_job_1_artifacts_report.json": [httpx.Response(200, stream=httpx.ByteStream(b'{"seed": 7}'))],
        }
    )
    view = JobView.model_validate(job(prompt="<b>bold</b>", state="succeeded"))
    with service.client() as client:
        result = Result(client, view)
        assert result._repr_png_() == result.preview() == png
        assert len(service.requests) == 1
        assert "&lt;b&gt;bold" in result._repr_html_()
        assert "<b>" not in result._repr_html_()
        assert "data:image/png;base64," in result._repr_html_()
        assert result.report() == {"seed": 7}
        assert result.verdict() is None
        assert "job_1" in repr(result)
        gone = Result(client, JobView.model_validate(job(id="job_2")))
        assert gone._repr_png_() is None
        assert gone._repr_html_().startswith("<p>job_2")
        with pytest.raises(MeshdeformError):
            gone.preview()
    with Client("http://127.0.0.1:1", max_retries=0) as closed:
        pass
    assert Result(closed, view)._repr_png_() is None
