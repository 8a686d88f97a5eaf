"""The object store on a real S3 server: the promises of every store, signed URLs, parts, and outages."""

from __future__ import annotations

import hashlib
import random
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from meshdeform.errors import UnavailableError
from meshdeform.storage import ObjectStore
from tests.fault_proxy import FaultProxy
from tests.s3_server import S3Server
from tests.unit.storage.test_store import (  # noqa: F401 - the same tests, here on S3
    test_a_copy_is_an_object_of_its_own,
    test_a_fetched_object_is_a_whole_file,
    test_a_list_names_every_key_below_a_prefix_with_its_size,
    test_a_signed_url_lives_up_to_a_week,
    test_delete_takes_one_or_a_folder_and_does_not_mind_none,
    test_parts_are_parts_of_the_whole,
    test_verified_bytes_are_read_back,
    test_what_is_not_there_is_not_found,
    test_what_is_put_is_got,
)

DATA = bytes(range(256)) * 17
# Three parts of a multipart upload, the last one short.
BIG = random.Random(1).randbytes(19_200_000)


@pytest.fixture
def store(s3_store_url: str) -> ObjectStore:
    """A store below a prefix of an empty bucket."""
    return ObjectStore(s3_store_url)


def whole_bucket(s3_store_url: str) -> ObjectStore:
    return ObjectStore(re.match(r"s3://[^/]+", s3_store_url)[0])  # type: ignore[index]


def test_everything_happens_below_the_prefix(store: ObjectStore, s3_store_url: str) -> None:
    outside = whole_bucket(s3_store_url)
    outside.put("jobs/a/1", b"not ours")
    outside.put("some/prefixed/jobs/a/1", b"not ours")
    store.put("jobs/a/1", b"ours")
    store.copy("jobs/a/1", "jobs/a/2")
    assert store.get("jobs/a/1") == b"ours"
    assert dict(store.list()) == {"jobs/a/1": 4, "jobs/a/2": 4}
    url = store.presign_put("jobs/a/3", 60)
    assert url is not None
    assert httpx.put(url, content=b"ours").is_success
    ours = [f"some/prefix/jobs/a/{number}" for number in (1, 2, 3)]
    assert [key for key, _ in outside.list("some/prefix/")] == ours
    store.delete("jobs/a/1")
    store.delete_prefix("jobs/")
    assert dict(outside.list()) == {"jobs/a/1": 8, "some/prefixed/jobs/a/1": 8}
    assert not store.exists("jobs/a/1")


def test_a_large_object_goes_up_in_parts_and_is_there_at_once(store: ObjectStore, tmp_path: Path) -> None:
    source, target = tmp_path / "source", tmp_path / "target"
    source.write_bytes(BIG)
    stored = store.put("big", source, "model/gltf-binary")
    store.copy("big", "copied")
    for key in ("big", "copied"):
        assert store.measure(key) == stored
        assert b"".join(store.stream(key, 8_388_000, 8_389_000)) == BIG[8_388_000:8_389_000]
        url = store.presign_get(key, 60)
        assert url is not None
        answer = httpx.get(url)
        assert answer.headers["Content-Type"] == "model/gltf-binary"
        # An ETag of parts ends with their number.
        assert answer.headers["ETag"].endswith('-3"')
        assert answer.content == BIG
    assert store.fetch("copied", target, sha256=hashlib.sha256(BIG).hexdigest()) == stored
    assert [key for key, _ in store.list()] == ["big", "copied"]


def test_the_memory_stays_flat(store: ObjectStore, s3_store_url: str, tmp_path: Path) -> None:
    source = tmp_path / "source"
    with source.open("wb") as file:
        file.truncate(96 << 20)  # more than the bound below
    # Not the peak of getrusage, which a process inherits from the one that started it.
    program = """
import sys
from pathlib import Path
from meshdeform.storage import ObjectStore
peak = lambda: int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) // 1024
store = ObjectStore(sys.argv[1])
store.put("small", b"x" * 1000)
store.get("small")
before = peak()
store.put("big", Path(sys.argv[2]))
store.fetch("big", Path(sys.argv[2] + ".back"))
print(peak() - before)
"""
    done = subprocess.run(
        [sys.executable, "-c", program, s3_store_url, source], check=True, capture_output=True, text=True
    )
    assert int(done.stdout) < 80
    assert store.size("big") == 96 << 20


class TestSignedUrls:
    """What the server makes of a URL that was signed for it."""

    def test_one_reads_and_one_writes(self, store: ObjectStore) -> None:
        put, get = store.presign_put("uploads/1", 60), store.presign_get("uploads/1", 60)
        assert put is not None
        assert get is not None
        assert httpx.get(get).status_code == 404
        assert httpx.put(put, content=DATA).status_code == 200
        assert store.get("uploads/1") == httpx.get(get).content == DATA
        assert httpx.get(get, headers={"Range": "bytes=5-9"}).content == DATA[5:10]

    def test_the_answer_has_the_name_and_the_type_that_were_stored(self, store: ObjectStore) -> None:
        store.put("jobs/1/result.glb", DATA, "model/gltf-binary")
        store.copy("jobs/1/result.glb", "jobs/1/copied.glb")
        for key in ("jobs/1/result.glb", "jobs/1/copied.glb"):
            url = store.presign_get(key, 60)
            assert url is not None
            answer = httpx.get(url)
            assert answer.content == DATA
            assert answer.headers["Content-Disposition"] == 'attachment; filename="result.glb"'
            assert answer.headers["Content-Type"] == "model/gltf-binary"


@pytest.mark.parametrize("wrong", ["credentials", "bucket"])
def test_what_the_server_refuses_is_no_missing_object(
    wrong: str, store: ObjectStore, s3_store_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.put("a", DATA)
    if wrong == "credentials":
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "another")
    refused = ObjectStore(s3_store_url if wrong == "credentials" else "s3://there-is-no-such-bucket/prefix")
    for call in (
        refused.ping,
        lambda: refused.get("a"),
        lambda: refused.put("a", b"x"),
        lambda: refused.size("a"),
        lambda: refused.exists("a"),
        lambda: refused.delete("a"),
        lambda: refused.copy("a", "b"),
        lambda: list(refused.list()),
        lambda: refused.delete_prefix("jobs/"),
    ):
        with pytest.raises(UnavailableError):
            call()
    assert store.get("a") == DATA


class TestOutages:
    """A proxy in front of the server fails; the store says so, soon, and never half."""

    @pytest.fixture
    def proxy(self, s3_server: S3Server, store: ObjectStore, monkeypatch: pytest.MonkeyPatch) -> Iterator[FaultProxy]:
        """In front of the server for the stores made after it; `store` looks past it."""
        with FaultProxy(s3_server.port) as proxy:
            monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{proxy.port}")
            yield proxy

    @pytest.fixture
    def beyond(self, proxy: FaultProxy, s3_store_url: str) -> ObjectStore:
        """The same store, seen through the proxy."""
        return ObjectStore(s3_store_url)

    @pytest.mark.parametrize("fault", ["error503", "refuse", "hang"])
    def test_every_method_says_that_the_store_is_away(
        self, fault: str, proxy: FaultProxy, beyond: ObjectStore, s3_store_url: str, tmp_path: Path
    ) -> None:
        beyond.put("a", DATA)
        getattr(proxy, fault)()
        hasty = ObjectStore(s3_store_url, patience_s=0.5)
        calls: list[Callable[[], object]] = [
            hasty.ping,
            lambda: beyond.ping(0.5),
            lambda: hasty.put("a", b"after"),
            lambda: hasty.put("big", BIG),
            lambda: hasty.put_verified("a", b"after"),
            lambda: hasty.get("a"),
            lambda: hasty.stream("a", 5, 9),
            lambda: hasty.size("a"),
            lambda: hasty.exists("a"),
            lambda: hasty.sha256_of("a"),
            lambda: hasty.fetch("a", tmp_path / "a"),
            lambda: hasty.copy("a", "b"),
            lambda: list(hasty.list()),
            lambda: hasty.delete("a"),
            lambda: hasty.delete_prefix("jobs/"),
        ]
        with ThreadPoolExecutor(len(calls)) as pool:
            for told in [pool.submit(call) for call in calls]:
                with pytest.raises(UnavailableError, match="does not answer"):
                    told.result()
        assert list(tmp_path.iterdir()) == []
        assert hasty.presign_get("a", 60) is not None
        proxy.pass_through()
        assert beyond.get("a") == DATA
        assert dict(beyond.list()) == {"a": len(DATA)}

    def test_a_download_that_is_cut_is_an_error(
        self, proxy: FaultProxy, beyond: ObjectStore, store: ObjectStore, tmp_path: Path, subtests: pytest.Subtests
    ) -> None:
        store.put("big", BIG)
        for count in (100, 10_000):
            with subtests.test(count):
                proxy.cut_after(count)
                for read in (lambda: beyond.get("big"), lambda: beyond.fetch("big", tmp_path / "big")):
                    with pytest.raises(UnavailableError):
                        read()
                assert list(tmp_path.iterdir()) == []
        proxy.cut_after(len(BIG) * 2 // 3)  # in the middle it goes on
        assert beyond.get("big") == BIG

    @pytest.mark.parametrize("count", [500, 5_000_000])
    def test_an_upload_that_is_cut_leaves_what_was_there(
        self, count: int, proxy: FaultProxy, beyond: ObjectStore, store: ObjectStore
    ) -> None:
        store.put("big", DATA)
        proxy.cut_after(count, upload=True)
        with pytest.raises(UnavailableError):
            beyond.put("big", BIG)
        assert store.get("big") == DATA
        proxy.pass_through()
        beyond.put("big", BIG)
        assert store.get("big") == BIG

    def test_an_outage_in_the_middle_of_a_stream_is_told_to_the_reader(
        self, proxy: FaultProxy, beyond: ObjectStore, store: ObjectStore
    ) -> None:
        store.put("big", BIG)
        parts = beyond.stream("big", chunk=65_536)
        got = [next(parts)]
        proxy.refuse()
        with pytest.raises(UnavailableError):
            got.extend(parts)
        assert BIG.startswith(b"".join(got))
        assert sum(map(len, got)) < len(BIG)


def test_signed_urls_name_the_host_that_clients_reach(s3_server: S3Server, s3_store_url: str) -> None:
    store = ObjectStore(s3_store_url, public_url=f"http://localhost:{s3_server.port}")
    store.put("a/b", b"bytes", "model/gltf-binary")
    url = store.presign_get("a/b", 60)
    assert url is not None
    assert url.startswith(f"http://localhost:{s3_server.port}/")
    answer = httpx.get(url)
    assert (answer.content, answer.headers["content-type"]) == (b"bytes", "model/gltf-binary")
    # The name is part of what is signed.
    assert httpx.get(url.replace("localhost", "127.0.0.1")).status_code == 403
    upload = store.presign_put("a/c", 60)
    assert upload is not None
    assert httpx.put(upload, content=b"more").is_success
    assert store.get("a/c") == b"more"
