"""What is known of a bucket without a server: settings, URLs, and a server that is away."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest

from meshdeform.errors import NotFoundError, UnavailableError
from meshdeform.storage import ObjectStore
from tests.servers import free_port

DATA = bytes(range(256)) * 17


@pytest.fixture(autouse=True)
def _keys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "id")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("AWS_REGION", "eu-central-1")


def test_a_bucket_that_is_away_is_unavailable_before_anybody_loses_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{free_port()}")
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    store = ObjectStore("s3://bucket/prefix")
    calls = [store.ping, lambda: store.get("a"), lambda: store.put("a", DATA), lambda: store.delete_prefix("jobs/a/")]
    for call in calls:
        with pytest.raises(UnavailableError, match="does not answer"):
            call()


GATEWAY = b"<html><body>404 Not Found</body></html>"
NO_OBJECT = b'<?xml version="1.0"?><Error><Code>NoSuchKey</Code><Message>None such</Message></Error>'
NO_BUCKET = b'<?xml version="1.0"?><Error><Code>NoSuchBucket</Code><Message>None such</Message></Error>'


@contextmanager
def answering_404(body: bytes) -> Iterator[str]:
    """A server that answers every request with 404, and its address."""

    class Answer(BaseHTTPRequestHandler):
        def answer(self) -> None:
            self.rfile.read(int(self.headers.get("Content-Length") or 0))
            self.send_response(404)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(body)

        do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = answer

        def log_message(self, *arguments: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


def calls_of(store: ObjectStore, folder: Path) -> list[Callable[[], object]]:
    return [
        lambda: store.get("a"),
        lambda: b"".join(store.stream("a", 1, 2)),
        lambda: store.size("a"),
        lambda: store.exists("a") or store.size("a"),
        lambda: store.fetch("a", folder / "fetched"),
        lambda: store.copy("a", "b"),
    ]


@pytest.mark.parametrize(("body", "says"), [(GATEWAY, "not as"), (b"", "not as"), (NO_BUCKET, "bucket does not exist")])
def test_only_the_store_itself_can_miss_an_object(
    body: bytes, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    with answering_404(body) as address:
        monkeypatch.setenv("AWS_ENDPOINT_URL", address)
        store = ObjectStore("s3://bucket/prefix")
        changes = [lambda: store.delete("a"), lambda: store.put("a", DATA), lambda: store.put("a", bytes(9 << 20))]
        for call in [*calls_of(store, tmp_path), *changes]:
            with pytest.raises(UnavailableError, match=says):
                call()
        # In one request each, in parts, and by listing: a missing bucket has the same name everywhere.
        listing = "bucket does not exist" if body == NO_BUCKET else None
        for call in (store.ping, lambda: list(store.list()), lambda: store.delete_prefix("jobs/")):
            with pytest.raises(UnavailableError, match=listing):
                call()


def test_an_object_is_missing_if_the_store_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    with answering_404(NO_OBJECT) as address:
        monkeypatch.setenv("AWS_ENDPOINT_URL", address)
        store = ObjectStore("s3://bucket/prefix")
        for call in calls_of(store, tmp_path):
            with pytest.raises(NotFoundError):
                call()
        assert not store.exists("a")
        store.delete("a")


def signed(store: ObjectStore) -> tuple[str, str, dict[str, list[str]]]:
    url = urlsplit(store.presign_get("jobs/a/result.glb", 60) or "")
    return f"{url.scheme}://{url.netloc}", url.path, parse_qs(url.query)


def test_the_environment_says_where_the_bucket_is(monkeypatch: pytest.MonkeyPatch) -> None:
    path = "/some/prefix/jobs/a/result.glb"
    host, found, query = signed(ObjectStore("s3://pail/some/prefix/"))
    assert (host, found) == ("https://s3.eu-central-1.amazonaws.com", f"/pail{path}")
    assert query["X-Amz-Credential"][0].split("/")[0::2] == ["id", "eu-central-1", "aws4_request"]
    assert query["X-Amz-Expires"] == ["60"]
    monkeypatch.setenv("AWS_VIRTUAL_HOSTED_STYLE_REQUEST", "true")
    assert signed(ObjectStore("s3://pail/some/prefix"))[:2] == ("https://pail.s3.eu-central-1.amazonaws.com", path)
    monkeypatch.setenv("AWS_ENDPOINT_URL", "https://pail.store.example.org")
    assert signed(ObjectStore("s3://pail/some/prefix"))[:2] == ("https://pail.store.example.org", path)
    monkeypatch.setenv("AWS_SESSION_TOKEN", "token")
    assert signed(ObjectStore("s3://pail"))[2]["X-Amz-Security-Token"] == ["token"]


@pytest.mark.parametrize("url", ["az://pail/prefix", "abfss://pail@account.dfs.core.windows.net/prefix"])
def test_azure_signs_as_well(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_NAME", "account")
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", "c2VjcmV0")
    store = ObjectStore(url)
    for text, permission in ((store.presign_get("a", 60), "r"), (store.presign_put("a", 60), "w")):
        assert text is not None
        parts = urlsplit(text)
        assert (parts.netloc, parts.path) == ("account.blob.core.windows.net", "/pail/prefix/a")
        assert permission in parse_qs(parts.query)["sp"][0]


def test_what_a_bucket_gives_and_copies_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    import obstore

    store = ObjectStore("memory://")
    store.put("a", DATA)
    real = obstore.get

    class Short:
        """An answer that ends early without saying so."""

        range = (0, len(DATA))

        def stream(self, min_chunk_size: int) -> list[bytes]:
            return [DATA[:-1]]

    monkeypatch.setattr(obstore, "get", lambda *arguments, **options: Short())
    with pytest.raises(UnavailableError, match="ends 1 bytes early"):
        store.get("a")
    monkeypatch.setattr(obstore, "get", real)
    assert store.get("a") == DATA
    store.put("b", b"before")
    monkeypatch.setattr(obstore, "copy", lambda *arguments: None)
    with pytest.raises(UnavailableError, match="did not copy all of a"):
        store.copy("a", "b")
    # Nor does it append.
    assert not store.appends
    with pytest.raises(NotImplementedError, match="presign_put"):
        store.append("a", 0, [b"x"], 10)
    assert store.presign_get("a", 60) is None


def test_a_bucket_that_cannot_be_opened_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    for url, says in (
        ("gopher://x/y", None),
        ("az://pail/x", "Account must be specified"),
        ("s3://pail", "AWS_CA_BUNDLE"),
    ):
        if url.startswith("s3"):
            monkeypatch.setenv("AWS_CA_BUNDLE", "/nonexistent/ca.pem")
        with pytest.raises(UnavailableError, match=says):
            ObjectStore(url)
