"""Uploads into the folder that break off and go on."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from meshdeform.errors import AssetTooLargeError, ConflictError, NotFoundError, UnavailableError
from meshdeform.storage import ObjectStore, StoredObject
from meshdeform.storage.folder import Folder
from tests.cases import each_case

DATA = bytes(range(256)) * 17
WHOLE = StoredObject(len(DATA), hashlib.sha256(DATA).hexdigest())
LIMIT = len(DATA)


@pytest.fixture
def store(tmp_path: Path) -> ObjectStore:
    return ObjectStore(tmp_path / "store")


def test_parts_become_an_object(store: ObjectStore) -> None:
    assert store.appends
    assert store.append("u1", 0, [], LIMIT) == 0
    assert store.append("u1", 0, [DATA[:100], b"", DATA[100:1000]], LIMIT) == 1000
    assert store.appended_size("u1") == 1000
    assert store.append("u1", 1000, iter([DATA[1000:]]), LIMIT) == len(DATA)
    assert store.appended("u1") == WHOLE
    assert not list(store.list())
    assert store.commit_append("u1", "assets/f/1") == WHOLE
    assert store.get("assets/f/1") == DATA
    with pytest.raises(NotFoundError):
        store.appended_size("u1")


@each_case("offset", [0, 99, 101, 10**9])
def test_bytes_that_belong_elsewhere_are_refused(store: ObjectStore, offset: int) -> None:
    upload = f"u{offset}"
    store.append(upload, 0, [DATA[:100]], LIMIT)
    with pytest.raises(ConflictError) as refusal:
        store.append(upload, offset, [b"x"], LIMIT)
    assert refusal.value.extra == {"offset": 100}
    assert store.appended(upload).sha256 == hashlib.sha256(DATA[:100]).hexdigest()


def test_an_upload_begins_at_zero_and_is_gone_once_it_is_discarded(store: ObjectStore) -> None:
    for call in (
        lambda: store.append("u1", 5, [b"x"], LIMIT),
        lambda: store.appended_size("u1"),
        lambda: store.appended("u1"),
        lambda: store.commit_append("u1", "a"),
    ):
        with pytest.raises(NotFoundError):
            call()
    store.append("u1", 0, [DATA], LIMIT)
    for _ in range(2):
        store.discard_append("u1")
    with pytest.raises(NotFoundError):
        store.appended_size("u1")


@each_case("upload_id", ["../a", "a/b", ".hidden", "", "a\n", "/etc/passwd"])
def test_no_upload_leads_out_of_its_folder(store: ObjectStore, upload_id: str, tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        store.append(upload_id, 0, [b"x"], LIMIT)
    with pytest.raises(NotFoundError):
        store.discard_append(upload_id)
    assert not list(store.list())
    assert [path.name for path in tmp_path.iterdir()] == ["store"]


def test_what_a_broken_off_append_brought_stays_if_it_is_on_the_disk_and_within_the_limit(
    store: ObjectStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks_off() -> Iterator[bytes]:
        yield DATA[:700]
        raise ConnectionResetError

    store.append("u1", 0, [], LIMIT)
    with pytest.raises(ConnectionResetError):
        store.append("u1", 0, breaks_off(), LIMIT)
    assert store.appended_size("u1") == 700
    assert store.append("u1", 700, [DATA[700:]], LIMIT) == len(DATA)
    assert store.commit_append("u1", "a") == WHOLE
    store.append("u2", 0, [DATA[:100]], LIMIT)
    with pytest.raises(AssetTooLargeError):
        store.append("u2", 100, [DATA[100:], b"x"], LIMIT)
    assert store.appended_size("u2") == 100

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(UnavailableError, match="disk is full"):
            store.append("u2", 100, [DATA[100:]], LIMIT)
    assert store.appended_size("u2") == 100
    assert store.append("u2", 100, [DATA[100:]], LIMIT) == LIMIT


def test_the_bytes_are_synced_before_append_returns(store: ObjectStore, monkeypatch: pytest.MonkeyPatch) -> None:
    if not Path("/proc/self/fd").is_dir():
        pytest.skip("this system has no /proc")
    synced: list[tuple[str, int]] = []

    def note(descriptor: int) -> None:
        synced.append((Path(f"/proc/self/fd/{descriptor}").readlink().name, os.fstat(descriptor).st_size))

    monkeypatch.setattr(os, "fsync", note)
    store.append("u1", 0, [DATA], LIMIT)
    assert [name for name, _ in synced] == ["store", ".uploads", "u1"]
    assert synced[-1] == ("u1", len(DATA))
    synced.clear()
    store.commit_append("u1", "jobs/a")
    assert synced[0] == ("u1", len(DATA))
    assert {name for name, _ in synced[1:]} == {"store", "jobs"}


def test_a_second_writer_is_refused_while_the_first_writes(store: ObjectStore) -> None:
    arrived, proceed = threading.Event(), threading.Event()

    def slow() -> Iterator[bytes]:
        yield DATA[:10]
        arrived.set()
        proceed.wait(30)
        yield DATA[10:]

    first = threading.Thread(target=store.append, args=("u1", 0, slow(), LIMIT))
    first.start()
    assert arrived.wait(30)
    for call in (lambda: store.append("u1", 10, [b"x"], LIMIT), lambda: store.commit_append("u1", "a")):
        with pytest.raises(ConflictError, match="Another request"):
            call()
    proceed.set()
    first.join()
    assert store.commit_append("u1", "a") == WHOLE


def test_a_commit_may_be_repeated_after_a_crash_before_or_after_the_rename(
    store: ObjectStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Crash(BaseException):
        pass

    real = Folder.rename_into_place

    def before(folder: Folder, aside: Path, key: str) -> None:
        raise Crash

    def after(folder: Folder, aside: Path, key: str) -> None:
        real(folder, aside, key)
        raise Crash

    for key, crash in (("a", before), ("b", after)):
        store.append(f"upload-{key}", 0, [DATA], LIMIT)
        with monkeypatch.context() as patch:
            patch.setattr(Folder, "rename_into_place", crash)
            with pytest.raises(Crash):
                store.commit_append(f"upload-{key}", key)
        for _ in range(2):
            assert store.commit_append(f"upload-{key}", key) == WHOLE
        assert store.get(key) == DATA
