"""Uploads over real sockets: in pieces, into a folder and into a bucket, broken off, completed at last."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest

from meshdeform.errors import NotFoundError, UnavailableError
from meshdeform.record.reconciler import remove_unreachable
from meshdeform.record.schema import uploads
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from tests.cases import each_case
from tests.integration.conftest import Api, serving_api
from tests.integration.http_calls import check_document, check_problem

TEXT = bytes(range(256)) * 40


def begin(api: Api, content: bytes = TEXT, filename: str = "text.bin", **more: Any) -> dict[str, Any]:
    """Announce an upload."""
    answer = api.http.post("/v1/uploads", json={"filename": filename, "size": len(content), **more})
    assert answer.status_code == 201, answer.text
    assert answer.headers["location"] == f"/v1/uploads/{answer.json()['id']}"
    found: dict[str, Any] = answer.json()
    return found


def send(api: Api, upload: dict[str, Any], content: bytes, start: int | None = None) -> httpx.Response:
    """Send bytes; from an offset on, if one is given."""
    where = {} if start is None else {"Content-Range": f"bytes {start}-{start + len(content) - 1}/{upload['size']}"}
    return api.http.put(upload["url"], content=content, headers={**upload["headers"], **where})


def complete(api: Api, upload: dict[str, Any], content: bytes = TEXT) -> httpx.Response:
    return api.http.post(f"/v1/uploads/{upload['id']}/complete", json={"sha256": hashlib.sha256(content).hexdigest()})


def offset(api: Api, upload: dict[str, Any]) -> int:
    head = api.http.head(upload["url"])
    assert head.status_code == 200
    assert head.headers["upload-length"] == str(upload["size"])
    return int(head.headers["upload-offset"])


def test_a_file_comes_in_pieces_and_is_named_by_a_job(api: Api, sphere: bytes, openapi: dict[str, Any]) -> None:
    upload = begin(api, sphere, "C:\\models\\sphere.glb")
    check_document(upload, "UploadView", openapi)
    assert (upload["state"], upload["method"], upload["resumable"]) == ("open", "PUT", True)
    assert upload["filename"] == "sphere.glb"
    assert offset(api, upload) == 0
    for start in range(0, len(sphere), 50_000):
        answer = send(api, upload, sphere[start : start + 50_000], start)
        assert answer.status_code == 204, answer.text
        assert int(answer.headers["upload-offset"]) == offset(api, upload) == min(start + 50_000, len(sphere))
    early = {"asset": {"upload_id": upload["id"]}, "prompt": "a mushroom"}
    check_problem(api.http.post("/v1/jobs", json=early), 409, "conflict")
    for _ in range(2):
        done = complete(api, upload, sphere)
        assert done.status_code == 200, done.text
        check_document(done.json(), "UploadView", openapi)
        assert (done.json()["state"], done.json()["url"]) == ("complete", None)
    assert api.http.get(f"/v1/uploads/{upload['id']}").json() == done.json()
    job = api.http.post("/v1/jobs", json=early)
    assert job.status_code == 202, job.text
    digest = hashlib.sha256(sphere).hexdigest()
    assert job.json()["asset"] == {"filename": "sphere.glb", "size": len(sphere), "sha256": digest}
    assert api.http.delete(f"/v1/uploads/{upload['id']}").status_code == 204
    remove_unreachable(api.record, api.store)
    assert api.store.get(f"assets/{digest}") == sphere
    assert list(api.store.list(f"uploads/{upload['id']}/")) == []
    check_problem(complete(api, upload, sphere), 404, "not_found")
    check_problem(send(api, upload, sphere), 404, "not_found")


def test_a_piece_that_does_not_begin_where_the_upload_ends_is_told_where_that_is(api: Api) -> None:
    upload = begin(api)
    assert send(api, upload, TEXT[:100], 0).status_code == 204
    for start in (0, 50, 101):
        problem = check_problem(send(api, upload, TEXT[start : start + 10], start), 409, "conflict")
        assert problem["offset"] == offset(api, upload) == 100
    assert send(api, upload, TEXT[100:], 100).status_code == 204
    assert complete(api, upload).status_code == 200
    check_problem(send(api, upload, TEXT), 409, "conflict")


@each_case(
    "header",
    ["bytes 0-9", "bytes 5-4/10240", "bytes 0-10240/10240", "bytes 0-9/999", "lines 0-9/10240", "bytes 0-9/*"],
)
def test_a_content_range_that_cannot_be_is_refused(api: Api, header: str) -> None:
    upload = begin(api)
    answer = api.http.put(upload["url"], content=TEXT[:10], headers={"Content-Range": header})
    check_problem(answer, 422, "request_invalid")


def test_other_bytes_than_announced_are_a_checksum_mismatch_and_can_be_corrected(api: Api) -> None:
    upload = begin(api, sha256=hashlib.sha256(TEXT).hexdigest().upper())
    assert check_problem(complete(api, upload), 422, "checksum_mismatch")["offset"] == 0
    send(api, upload, TEXT[:-1], 0)
    assert check_problem(complete(api, upload), 422, "checksum_mismatch")["offset"] == len(TEXT) - 1
    send(api, upload, b"?", len(TEXT) - 1)
    check_problem(complete(api, upload), 422, "checksum_mismatch")
    check_problem(complete(api, upload, b"other"), 422, "checksum_mismatch")
    send(api, upload, TEXT)
    assert complete(api, upload).status_code == 200
    check_problem(complete(api, upload, b"other"), 422, "checksum_mismatch")


def test_a_signed_url_lets_its_bearer_do_one_thing(api: Api) -> None:
    upload, other = begin(api), begin(api)
    path, query = upload["url"].split("?")
    for url in (
        path,
        f"{path}?{query[:-1]}",
        f"{path}?{query}&more=1",
        f"{path}?expires=99999999999&{query.split('&')[1]}",
        f"/v1/uploads/{other['id']}/content?{query}",
    ):
        check_problem(api.http.put(url, content=TEXT), 403, "forbidden")
        assert api.http.head(url).status_code == 403


@pytest.mark.parametrize("point", ["copy", "holds", "recorded", "removed"])
def test_completing_goes_on_wherever_it_stopped(api: Api, monkeypatch: pytest.MonkeyPatch, point: str) -> None:
    """A process that dies between two steps leaves what a failing step leaves."""

    def away(*_: object, **__: object) -> None:
        raise UnavailableError("The power is gone.")

    content = TEXT + point.encode()
    upload = begin(api, content)
    send(api, upload, content)
    place = {
        "copy": "meshdeform.storage.ObjectStore.copy",
        "holds": "meshdeform.storage.ObjectStore.holds",
        "recorded": "meshdeform.record.uploads.UploadLedger.complete",
        "removed": "service.uploads.receiving.remove_upload",
    }[point]
    with monkeypatch.context() as patch:
        patch.setattr(place, away)
        stopped = complete(api, upload, content)
    assert stopped.status_code == (200 if point == "removed" else 503)
    assert complete(api, upload, content).status_code == 200
    assert api.store.get(f"assets/{hashlib.sha256(content).hexdigest()}") == content


def test_bytes_that_change_while_they_are_looked_at_are_never_stored_under_a_wrong_name(
    api: Api, monkeypatch: pytest.MonkeyPatch
) -> None:
    upload = begin(api)
    send(api, upload, TEXT)
    look = ObjectStore.appended

    def look_and_change(store: ObjectStore, upload_id: str) -> Any:
        found = look(store, upload_id)
        store.discard_append(upload_id)
        store.append(upload_id, 0, [bytes(len(TEXT))], len(TEXT))
        return found

    key = f"assets/{hashlib.sha256(TEXT).hexdigest()}"
    api.store.delete(key)
    with monkeypatch.context() as patch:
        patch.setattr("meshdeform.storage.ObjectStore.appended", look_and_change)
        check_problem(complete(api, upload), 422, "checksum_mismatch")
    assert not api.store.exists(key)


def test_an_upload_whose_time_is_over_is_removed_with_its_bytes(api: Api) -> None:
    opened, done = begin(api), begin(api, TEXT + b"!")
    send(api, opened, TEXT[:10], 0)
    send(api, done, TEXT + b"!")
    assert complete(api, done, TEXT + b"!").status_code == 200
    key = f"assets/{hashlib.sha256(TEXT + b'!').hexdigest()}"
    remove_unreachable(api.record, api.store)
    assert api.store.exists(key)
    database = api.record.database
    with database.write() as connection:
        connection.execute(uploads.update().values(expires_at=database.now(-1.0)))
    check_problem(api.http.get(f"/v1/uploads/{opened['id']}"), 404, "not_found")
    assert api.store.appended_size(opened["id"]) == 10
    remove_unreachable(api.record, api.store)
    assert not api.store.exists(key)
    with pytest.raises(NotFoundError):
        api.store.appended_size(opened["id"])
    assert api.http.head(opened["url"]).status_code == 404
    with database.read() as connection:
        assert connection.execute(uploads.select()).all() == []


@each_case(
    ("document", "loc"),
    [
        ({"size": 1}, "filename"),
        ({"filename": "", "size": 1}, "filename"),
        ({"filename": "a", "size": 0}, "size"),
        ({"filename": "a", "size": 1, "sha256": "xyz"}, "sha256"),
        ({"filename": "a", "size": 1, "color": 1}, "color"),
    ],
)
def test_a_bad_announcement_says_what_is_wrong(api: Api, document: Any, loc: str) -> None:
    problem = check_problem(api.http.post("/v1/uploads", json=document), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == [loc]


@pytest.fixture
def bucket_api(own_settings: Callable[..., Settings], s3_store_url: str) -> Iterator[Api]:
    """The API on a bucket."""
    with serving_api(own_settings(storage_url=s3_store_url, max_upload_bytes=2**20)) as found:
        yield found


def test_into_a_bucket_the_bytes_go_straight(bucket_api: Api, sphere: bytes) -> None:
    upload = begin(bucket_api, sphere, "sphere.glb")
    assert upload["url"].startswith("http")
    assert not upload["resumable"]
    assert check_problem(complete(bucket_api, upload, sphere), 422, "checksum_mismatch")["offset"] == 0
    with httpx.Client(timeout=240) as nobody:
        for content in (sphere[:-1], sphere[:-1] + b"?"):
            assert nobody.put(upload["url"], content=content, headers=upload["headers"]).status_code == 200
            check_problem(complete(bucket_api, upload, sphere), 422, "checksum_mismatch")
        assert nobody.put(upload["url"], content=sphere, headers=upload["headers"]).status_code == 200
        assert bucket_api.http.get(f"/v1/uploads/{upload['id']}").json()["offset"] == len(sphere)
        assert complete(bucket_api, upload, sphere).status_code == 200
        # The URL is still good for the bucket, but what is written there now is nobody's.
        nobody.put(upload["url"], content=bytes(len(sphere)), headers=upload["headers"])
    job = bucket_api.http.post("/v1/jobs", json={"asset": {"upload_id": upload["id"]}, "prompt": "a mushroom"})
    assert job.status_code == 202, job.text
    assert bucket_api.store.get(bucket_api.record.get(job.json()["id"]).files["asset"].key) == sphere
    assert bucket_api.http.delete(f"/v1/uploads/{upload['id']}").status_code == 204
    assert list(bucket_api.store.list(f"uploads/{upload['id']}/")) == []
