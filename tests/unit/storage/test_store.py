"""The object store: the same promises from a folder and from what obstore opens.

tests/integration/test_s3.py runs the same tests on a real S3 server.
"""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import BinaryIO

import pytest

from meshdeform.errors import NotFoundError, StoredFileError, UnavailableError
from meshdeform.storage import ObjectStore, StoredObject
from tests.cases import each_case

DATA = bytes(range(256)) * 17


@pytest.fixture(params=["folder", "memory"])  # test_s3.py is another bucket
def store(request: pytest.FixtureRequest, tmp_path: Path) -> ObjectStore:
    return ObjectStore(tmp_path / "deep" / "store" if request.param == "folder" else "memory://")


def test_what_is_put_is_got(store: ObjectStore, tmp_path: Path) -> None:
    store.ping()
    source = tmp_path / "source.bin"
    source.write_bytes(DATA)
    # The last one takes the place of the first.
    for key, data in (("jobs/a/1/result.glb", DATA), ("assets/f00", source), ("jobs/a/1/result.glb", b"")):
        content = data if isinstance(data, bytes) else DATA
        stored = store.put(key, data, "model/gltf-binary")
        assert (stored.size, stored.sha256) == (len(content), hashlib.sha256(content).hexdigest())
        assert store.get(key) == content
        assert store.size(key) == len(content)
        assert store.exists(key)
        assert store.sha256_of(key) == stored.sha256
    assert list(store.stream("jobs/a/1/result.glb", 0, 0)) == []
    folder = tmp_path / "url"
    ObjectStore(f"file://{folder}").put("a/b", DATA)
    assert ObjectStore(folder).get("a/b") == DATA


@each_case(
    ("start", "end"),
    [
        (0, None),
        (0, 1),
        (5, 5),
        (100, 200),
        (4000, None),
        (4351, 4352),
        (4000, 9000),
        (4352, None),
        (9000, None),
        (9000, 9001),
    ],
)
def test_parts_are_parts_of_the_whole(store: ObjectStore, start: int, end: int | None) -> None:
    store.put("a", DATA)
    assert b"".join(store.stream("a", start, end, chunk=64)) == DATA[start:end]


def test_what_is_not_there_is_not_found(store: ObjectStore) -> None:
    store.put("a/b", b"x")
    for key in ("nothing", "a/b/c", "a", "../a", "/etc/passwd", "a//b", "", ".partial/x", "a/./b", "a/\n"):
        with pytest.raises(NotFoundError):
            store.get(key)
        with pytest.raises(NotFoundError):
            # Not when the first part is asked for, which is when the headers of an answer have left.
            store.stream(key)
        with pytest.raises(NotFoundError):
            store.sha256_of(key)
        assert not store.exists(key)


def test_delete_takes_one_or_a_folder_and_does_not_mind_none(store: ObjectStore) -> None:
    store.put("a/1", b"x")
    store.put("a/2", b"x")
    store.delete("a/1")
    store.delete("a/1")
    assert not store.exists("a/1")
    assert store.exists("a/2")
    for key in ("jobs/a/1/x", "jobs/a/2/y", "jobs/ab/1/x"):
        store.put(key, b"x")
    store.delete_prefix("jobs/a/")
    store.delete_prefix("jobs/nothing/")
    assert not store.exists("jobs/a/1/x")
    assert not store.exists("jobs/a/2/y")
    assert store.exists("jobs/ab/1/x")


def test_verified_bytes_are_read_back(store: ObjectStore, monkeypatch: pytest.MonkeyPatch) -> None:
    assert store.put_verified("a", DATA, "model/gltf-binary") == StoredObject(
        len(DATA), hashlib.sha256(DATA).hexdigest()
    )
    real = store._backend.put

    def torn(key: str, source: BinaryIO, content_type: str) -> None:
        real(key, io.BytesIO(source.read()[:-1]), content_type)

    def lost(key: str, source: BinaryIO, content_type: str) -> None:
        pass

    for fault in (torn, lost):
        monkeypatch.setattr(store._backend, "put", fault)
        with pytest.raises(UnavailableError, match="did not store b"):
            store.put_verified("b", DATA)
        assert not store.exists("b")


def test_a_copy_is_an_object_of_its_own(store: ObjectStore) -> None:
    store.put("uploads/1", DATA)
    store.put("assets/f", b"before")
    store.copy("uploads/1", "assets/f")
    store.copy("uploads/1", "new/folder/f")
    store.delete("uploads/1")
    assert store.get("assets/f") == store.get("new/folder/f") == DATA
    with pytest.raises(NotFoundError):
        store.copy("uploads/1", "assets/f")
    assert store.get("assets/f") == DATA


def test_a_list_names_every_key_below_a_prefix_with_its_size(store: ObjectStore) -> None:
    wanted = {f"jobs/a/{number // 5}/x{number:02d}": number for number in range(25)}
    for key, size in wanted.items():
        store.put(key, b"x" * size)
    store.put("jobs/ab/1/y", b"y")
    assert dict(store.list("jobs/a/")) == wanted
    assert dict(store.list("jobs/a/2")) == {key: size for key, size in wanted.items() if key.startswith("jobs/a/2/")}
    assert dict(store.list()) == {**wanted, "jobs/ab/1/y": 1}
    assert list(store.list("nothing/")) == []
    assert list(store.list("jobs/ab/1/y")) in ([], [("jobs/ab/1/y", 1)])


def test_a_fetched_object_is_a_whole_file(store: ObjectStore, tmp_path: Path) -> None:
    target = tmp_path / "target" / "result.glb"
    target.parent.mkdir()
    target.write_bytes(b"before")
    stored = store.put("a", DATA)
    with pytest.raises(StoredFileError, match="differs from what was stored"):
        store.fetch("a", target, sha256=hashlib.sha256(b"others").hexdigest())
    with pytest.raises(NotFoundError):
        store.fetch("nothing", target)
    assert target.read_bytes() == b"before"
    assert store.fetch("a", target, sha256=stored.sha256) == stored
    assert target.read_bytes() == DATA
    assert list(target.parent.iterdir()) == [target]


@each_case("expires_s", [0, -1, 8 * 86_400])
def test_a_signed_url_lives_up_to_a_week(store: ObjectStore, expires_s: int) -> None:
    for sign in (store.presign_get, store.presign_put):
        with pytest.raises(ValueError, match="must live 1 to"):
            sign("a", expires_s)
        with pytest.raises(NotFoundError):
            sign("../a", 60)
