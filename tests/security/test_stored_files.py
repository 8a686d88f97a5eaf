"""Damage a stored file: nobody gets other bytes than were sent, and sending the file again repairs it."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from meshdeform.client import Client
from meshdeform.errors import StoredFileError
from meshdeform.record.models import JobState
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore, folder
from tests.cases import each_case
from tests.integration.conftest import Api
from tests.integration.http_calls import check_problem, finished_job, post
from tests.worker_world import new_world

DAMAGES = {
    "flipped": lambda data: data[:100] + bytes([data[100] ^ 1, data[101] ^ 1]) + data[102:],
    "cut": lambda data: data[: len(data) // 2],
}


def damage(api: Api, key: str, how: str) -> None:
    path = Path(api.settings.resolved_storage_url) / key
    path.write_bytes(DAMAGES[how](path.read_bytes()))


def posted(api: Api, content: bytes) -> str:
    answer = post(api, content)
    assert answer.status_code == 202, answer.text
    return str(answer.json()["id"])


@each_case("how", DAMAGES)
def test_posting_the_same_file_again_replaces_a_damaged_copy(api: Api, sphere: bytes, how: str) -> None:
    job_id = posted(api, sphere)
    key = api.record.get(job_id).files["asset"].key
    damage(api, key, how)
    for headers in ({}, {"Range": "bytes=0-9"}):
        check_problem(api.http.get(f"/v1/jobs/{job_id}/asset", headers=headers), 500, "file_damaged")
    posted(api, sphere)
    assert api.store.get(key) == sphere
    assert api.http.get(f"/v1/jobs/{job_id}/asset").content == sphere


@each_case("how", DAMAGES)
def test_completing_an_upload_of_the_same_file_replaces_a_damaged_copy(api: Api, sphere: bytes, how: str) -> None:
    file = api.record.get(posted(api, sphere)).files["asset"]
    damage(api, file.key, how)
    document = {"filename": "sphere.glb", "size": len(sphere)}
    upload = api.http.post("/v1/uploads", json=document).json()
    assert httpx.put(f"{api.url}{upload['url']}", content=sphere).status_code == 204
    done = api.http.post(f"/v1/uploads/{upload['id']}/complete", json={"sha256": file.sha256})
    assert done.status_code == 200, done.text
    assert api.store.get(file.key) == sphere


@each_case("size", [10_000, 4_000_000])
def test_nobody_gets_a_byte_of_a_damaged_result(api: Api, tmp_path: Path, size: int) -> None:
    job_id = finished_job(api, bytes(size))
    url = f"/v1/jobs/{job_id}/artifacts/result.glb"
    assert api.http.get(url, headers={"Range": "bytes=1-"}).content == bytes(size - 1)
    damage(api, f"jobs/{job_id}/1/result.glb", "flipped")
    for headers in ({}, {"Range": "bytes=1-"}, {"Range": "bytes=-1"}):
        check_problem(api.http.get(url, headers=headers), 500, "file_damaged")
    with Client(api.url) as client, pytest.raises(StoredFileError):
        client.download(job_id, "result.glb", tmp_path / f"{size}.glb")
    assert not (tmp_path / f"{size}.glb").exists()


def test_a_job_with_a_damaged_file_cannot_be_retried_until_the_file_is_sent_again(api: Api, sphere: bytes) -> None:
    job_id = posted(api, sphere)
    assert api.http.post(f"/v1/jobs/{job_id}/cancel").status_code == 200
    damage(api, api.record.get(job_id).files["asset"].key, "flipped")
    check_problem(api.http.post(f"/v1/jobs/{job_id}/retry"), 500, "file_damaged")
    posted(api, sphere)
    assert api.http.post(f"/v1/jobs/{job_id}/retry").status_code == 202


@each_case("how", DAMAGES)
def test_a_worker_does_not_start_on_a_damaged_file(tmp_path: Path, how: str) -> None:
    with new_world(tmp_path / how) as world:
        job = world.create()
        (tmp_path / how / "objects/assets/a").write_bytes(b"an assEt" if how == "flipped" else b"an")
        for _ in range(Settings().max_attempts):  # the file may be sent again meanwhile
            world.runner(settings=Settings(retry_delay_s=0)).run(job.id)
        failed = world.record.get(job.id)
        assert failed.state is JobState.FAILED
        assert failed.error is not None
        assert failed.error.code == "file_damaged"
        assert world.kind.started == []


def test_a_name_is_trusted_only_after_its_folder_is_synced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = ObjectStore(tmp_path)
    stored = store.put("assets/a", b"content")
    synced: list[Path] = []
    monkeypatch.setattr(folder, "sync_folder", synced.append)
    assert store.holds("assets/a", stored.sha256)
    assert synced == [tmp_path / "assets", tmp_path]
    assert not store.holds("assets/b", stored.sha256)
    assert not store.holds("assets/a", "0" * 64)
