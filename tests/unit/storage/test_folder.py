"""The object store in a folder: what is promised of the disk."""

from __future__ import annotations

import fcntl
import io
import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from meshdeform.errors import MeshdeformError, NotFoundError, UnavailableError
from meshdeform.storage import ObjectStore, folder
from meshdeform.storage.folder import Folder

DATA = b"bytes of an object"


def leave(root: Path, *, empty: bool) -> Path:
    """Take a store away, as an unmounted disk is, and return where it is."""
    elsewhere = root.with_name("elsewhere")
    root.rename(elsewhere)
    if empty:
        root.mkdir()
    return elsewhere


def come_back(root: Path, elsewhere: Path) -> None:
    if root.exists():
        root.rmdir()
    elsewhere.rename(root)


@pytest.mark.parametrize("empty", [False, True], ids=["missing", "empty"])
@pytest.mark.parametrize("create", [False, True], ids=["opened", "created"])
def test_a_store_that_is_away_lacks_nothing(tmp_path: Path, empty: bool, create: bool) -> None:
    root = tmp_path / "store"
    store = ObjectStore(root)
    store.put("jobs/a/1/x", DATA)
    store.append("upload", 0, [DATA], 1000)
    elsewhere = leave(root, empty=empty)
    if not create:
        store = ObjectStore(root, create=False)
    calls: dict[str, Callable[[], object]] = {
        "ping": store.ping,
        "get": lambda: store.get("jobs/a/1/x"),
        "get of none": lambda: store.get("jobs/b"),
        "size": lambda: store.size("jobs/a/1/x"),
        "exists": lambda: store.exists("jobs/a/1/x"),
        "holds": lambda: store.holds("jobs/a/1/x", "0" * 64),
        "measure": lambda: store.measure("jobs/a/1/x"),
        "fetch": lambda: store.fetch("jobs/a/1/x", tmp_path / "fetched"),
        "copy": lambda: store.copy("jobs/a/1/x", "jobs/b"),
        "list": lambda: list(store.list()),
        "delete": lambda: store.delete("jobs/a/1/x"),
        "delete_prefix": lambda: store.delete_prefix("jobs/a/"),
        "put": lambda: store.put("jobs/a/2/x", DATA),
        "append": lambda: store.append("upload", len(DATA), [DATA], 1000),
        "begin": lambda: store.append("another", 0, [DATA], 1000),
        "appended": lambda: store.appended("upload"),
        "appended_size": lambda: store.appended_size("upload"),
        "commit": lambda: store.commit_append("upload", "assets/u"),
        "discard": lambda: store.discard_append("upload"),
    }
    for name, call in calls.items():
        with pytest.raises(UnavailableError, match="missing or empty"):
            pytest.fail(f"{name} gave {call()!r}")
    assert not root.exists() or list(root.iterdir()) == []
    come_back(root, elsewhere)
    assert store.get("jobs/a/1/x") == DATA
    assert [key for key, _ in store.list()] == ["jobs/a/1/x"]
    assert store.commit_append("upload", "assets/u").size == len(DATA)
    assert not store.exists("jobs/b")


def test_a_store_that_comes_back_during_a_read_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "store"
    store = ObjectStore(root)
    store.put("jobs/a", DATA)
    elsewhere = leave(root, empty=True)
    real = Folder.ping

    def ping(folder: Folder, timeout_s: float | None = None) -> None:
        if elsewhere.exists():
            come_back(root, elsewhere)
        real(folder, timeout_s)

    monkeypatch.setattr(Folder, "ping", ping)
    assert store.get("jobs/a") == DATA


def test_a_store_that_goes_during_a_write_gets_no_folders(tmp_path: Path) -> None:
    root = tmp_path / "store"
    store = ObjectStore(root)
    elsewhere = tmp_path / "elsewhere"

    class Unmounting(io.BytesIO):
        def read(self, size: int | None = -1) -> bytes:
            if root.exists() and not elsewhere.exists():
                leave(root, empty=True)
            return super().read(size)

    with pytest.raises(UnavailableError):
        Folder(root).put("jobs/a/1/x", Unmounting(DATA), "")
    assert list(root.iterdir()) == []
    come_back(root, elsewhere)
    assert not store.exists("jobs/a/1/x")


def test_a_write_that_breaks_off_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = ObjectStore(tmp_path / "store")
    store.put("a/b", b"before")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    for write in (store.put, store.put_verified):
        with pytest.raises(UnavailableError, match="No space left") as refusal:
            write("a/b", b"after")
        assert "Free space" in refusal.value.advice_text
        assert store.get("a/b") == b"before"
        assert list((tmp_path / "store" / ".partial").iterdir()) == []


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


_WRITER = """
import io, os, sys, time
from pathlib import Path
from meshdeform.storage import ObjectStore

class Slow(io.RawIOBase):
    def readable(self): return True
    def readinto(self, buffer):
        print("writing", flush=True)
        time.sleep(60.0)

ObjectStore(sys.argv[1])._backend.put("a", io.BufferedReader(Slow()), "")
"""


def test_what_was_left_aside_goes_at_the_next_start(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _WRITER, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"writing\n"
        (left,) = (tmp_path / ".partial").iterdir()
        ObjectStore(tmp_path)
        assert left.exists(), "its writer lives"
        writer.kill()
    ObjectStore(tmp_path)
    assert not left.exists()
    # What a process without locks left goes after an hour.
    old, new = tmp_path / ".partial" / "old", tmp_path / ".partial" / "new"
    for path, age_s in ((old, 4000), (new, 10)):
        path.write_bytes(b"half")
        os.utime(path, (time.time() - age_s,) * 2)
    ObjectStore(tmp_path)
    assert not old.exists()
    assert new.exists()


def test_a_file_that_another_start_removed_before_it_was_locked_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, lock, starts = ObjectStore(tmp_path), fcntl.flock, iter([True])

    def late(file: int, how: int) -> None:
        if next(starts, False):
            ObjectStore(tmp_path)
        lock(file, how)

    monkeypatch.setattr(folder.fcntl, "flock", late)
    store.put("a", b"whole")
    assert store.get("a") == b"whole"
    assert list((tmp_path / ".partial").iterdir()) == []


def test_a_file_that_ends_early_is_no_whole_object(tmp_path: Path) -> None:
    store = ObjectStore(tmp_path)
    store.put("a", bytes(1_000_000))
    parts = store.stream("a", chunk=100_000)
    next(parts)
    with (tmp_path / "a").open("r+b") as file:
        file.truncate(500_000)
    with pytest.raises(UnavailableError, match="bytes early"):
        list(parts)


def test_only_objects_are_listed_and_no_key_leads_out_of_the_folder(tmp_path: Path) -> None:
    store = ObjectStore(tmp_path)
    store.put("jobs/a", b"x")
    (tmp_path / ".partial" / "tmp1").write_bytes(b"half")
    (tmp_path / "jobs" / "no key!").write_bytes(b"x")
    (tmp_path / "jobs" / "lost").symlink_to(tmp_path / "nowhere")
    (tmp_path / "jobs" / "folder").symlink_to(tmp_path)
    assert list(store.list()) == [("jobs/a", 1)]
    assert store.presign_get("a", 60) is store.presign_put("a", 60) is None  # a folder has no URLs of its own
    for key in ("../outside", "a/../../outside", "/outside", ".partial/x", "a/.b"):
        with pytest.raises(NotFoundError):
            store.put(key, b"x")
    with pytest.raises(MeshdeformError):
        ObjectStore(tmp_path / "jobs" / "a" / "store")
