"""The object store: the same promises from a folder and from what obstore opens."""

from __future__ import annotations

import hashlib
import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from meshdeform.errors import MeshdeformError, NotFoundError, UnavailableError
from meshdeform.storage import ObjectStore
from tests.servers import free_port

DATA = bytes(range(256)) * 17


@pytest.fixture(params=["folder", "file url", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> ObjectStore:
    folder = tmp_path / "deep" / "store"
    return ObjectStore({"folder": folder, "file url": f"file://{folder}", "memory": "memory://"}[request.param])


def test_what_is_put_is_got(store: ObjectStore, tmp_path: Path) -> None:
    source = tmp_path / "source.bin"
    source.write_bytes(DATA)
    for key, data in (("jobs/a/1/result.glb", DATA), ("assets/f00", source)):
        stored = store.put(key, data, "model/gltf-binary")
        assert (stored.size, stored.sha256) == (len(DATA), hashlib.sha256(DATA).hexdigest())
        assert store.get(key) == DATA
        assert store.size(key) == len(DATA)
        assert store.exists(key)


def test_a_second_put_takes_the_place_of_the_first(store: ObjectStore) -> None:
    store.put("a", DATA)
    store.put("a", b"short")
    assert store.get("a") == b"short"


@pytest.mark.parametrize(("start", "end"), [(0, None), (0, 1), (5, 5), (100, 200), (4000, None), (4351, 4352)])
def test_parts_are_parts_of_the_whole(store: ObjectStore, start: int, end: int | None) -> None:
    store.put("a", DATA)
    assert b"".join(store.stream("a", start, end, chunk=64)) == DATA[start:end]


def test_an_empty_object_is_an_object(store: ObjectStore) -> None:
    store.put("a", b"")
    assert store.get("a") == b""
    assert store.size("a") == 0
    assert list(store.stream("a", 0, 0)) == []


def test_what_is_not_there_is_not_found(store: ObjectStore) -> None:
    store.put("a/b", b"x")
    for key in ("nothing", "a/b/c", "a", "../a", "/etc/passwd", "a//b", "", ".partial/x", "a/./b", "a/\n"):
        with pytest.raises(NotFoundError):
            store.get(key)
        with pytest.raises(NotFoundError):
            # Not when the first part is asked for, which is when the headers of an answer have left.
            store.stream(key)
        assert not store.exists(key)


def test_no_key_leads_out_of_the_folder(tmp_path: Path) -> None:
    store = ObjectStore(tmp_path / "store")
    for key in ("../outside", "a/../../outside", "/outside", ".partial/x", "a/.b"):
        with pytest.raises(NotFoundError):
            store.put(key, b"x")
    assert [path.name for path in tmp_path.iterdir()] == ["store"]


def test_delete_takes_one_and_does_not_mind_none(store: ObjectStore) -> None:
    store.put("a/1", b"x")
    store.put("a/2", b"x")
    store.delete("a/1")
    store.delete("a/1")
    assert not store.exists("a/1")
    assert store.exists("a/2")


def test_a_prefix_is_a_folder_and_not_the_beginning_of_a_name(store: ObjectStore) -> None:
    for key in ("jobs/a/1/x", "jobs/a/2/y", "jobs/ab/1/x"):
        store.put(key, b"x")
    store.delete_prefix("jobs/a/")
    store.delete_prefix("jobs/nothing/")
    assert not store.exists("jobs/a/1/x")
    assert not store.exists("jobs/a/2/y")
    assert store.exists("jobs/ab/1/x")


def test_a_store_that_is_there_answers(store: ObjectStore) -> None:
    store.ping()


def test_a_folder_that_vanished_does_not_answer(tmp_path: Path) -> None:
    store = ObjectStore(tmp_path / "store")
    (tmp_path / "store" / ".partial").rmdir()
    (tmp_path / "store").rmdir()
    with pytest.raises(MeshdeformError):
        store.ping()


def test_a_folder_that_cannot_be_made_is_unavailable(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(MeshdeformError):
        ObjectStore(tmp_path / "file" / "store")


def test_a_location_that_obstore_does_not_know_is_unavailable() -> None:
    with pytest.raises(UnavailableError):
        ObjectStore("gopher://somewhere/else")


def test_a_write_that_breaks_off_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = ObjectStore(tmp_path)
    store.put("a/b", b"before")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UnavailableError, match="No space left"):
        store.put("a/b", b"after")
    assert store.get("a/b") == b"before"
    assert list((tmp_path / ".partial").iterdir()) == []


def test_the_bytes_and_every_new_name_are_synced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = ObjectStore(tmp_path)
    synced: list[str] = []
    real = os.fsync

    def note(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)
        real(descriptor)

    if not Path("/proc/self/fd").is_dir():
        pytest.skip("this system has no /proc")
    monkeypatch.setattr(os, "fsync", note)
    store.put("jobs/a/1/x", b"x")
    assert set(synced[1:]) == {tmp_path.name, "jobs", "a", "1"}
    synced.clear()
    store.put("jobs/a/1/y", b"y")
    assert synced[1:] == ["1"]


def test_readers_see_the_old_bytes_or_the_new_and_never_half(tmp_path: Path) -> None:
    store = ObjectStore(tmp_path)
    versions = [bytes([letter]) * 100_000 for letter in b"abcdef"]
    store.put("k", versions[0])
    with ThreadPoolExecutor(3) as pool:
        writes = [pool.submit(store.put, "k", version) for version in versions * 5]
        seen = [store.get("k") for _ in range(50)]
        for write in writes:
            write.result()
    assert set(seen) <= set(versions)


def test_what_a_dead_process_left_aside_goes_after_a_day(tmp_path: Path) -> None:
    ObjectStore(tmp_path)
    old, new = tmp_path / ".partial" / "old", tmp_path / ".partial" / "new"
    for path, age_s in ((old, 100_000), (new, 10)):
        path.write_bytes(b"half")
        os.utime(path, (time.time() - age_s,) * 2)
    ObjectStore(tmp_path)
    assert not old.exists()
    assert new.exists()


def test_a_bucket_that_is_away_is_unavailable_before_anybody_loses_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {
        "AWS_ACCESS_KEY_ID": "id",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{free_port()}",
        "AWS_ALLOW_HTTP": "true",
    }.items():
        monkeypatch.setenv(name, value)
    store = ObjectStore("s3://bucket/prefix")
    calls = [store.ping, lambda: store.get("a"), lambda: store.put("a", DATA), lambda: store.delete_prefix("jobs/a/")]
    for call in calls:
        with pytest.raises(UnavailableError, match="does not answer"):
            call()
