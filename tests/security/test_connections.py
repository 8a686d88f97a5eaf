"""Clients that hold connections without using them: idle, in the middle of a header or body, or not reading."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from starlette.requests import Request
from starlette.responses import Response

from meshdeform.serving import connections
from meshdeform.settings import Settings
from service.http import middleware
from tests.acceptance.cluster import API, deployed
from tests.integration.conftest import DEADLINE_S, serving, serving_app

OPEN_FILES = 160
HEADER = b"GET /healthz HTTP/1.1\r\nHost: x\r\n"
SENT = (b"", HEADER, HEADER + b"\r\n")


def connect(url: str, sent: bytes = b"") -> socket.socket:
    address = httpx.URL(url)
    found = socket.create_connection((address.host, address.port or 80), timeout=DEADLINE_S)
    found.sendall(sent)
    return found


def received(connection: socket.socket) -> bytes:
    """Return everything until the server closes the connection."""
    found = b""
    try:
        while data := connection.recv(65_536):
            found += data
    except ConnectionResetError:
        pass
    return found


def test_idle_connections_keep_nobody_out(tmp_path: Path) -> None:
    """More connections than the process may have open files, all of them held while others work."""
    with deployed(tmp_path) as cluster, ExitStack() as cleanup:
        cluster.start_api(["sh", "-c", f'ulimit -n {OPEN_FILES}; exec "$@"', "sh", *API])
        url = str(cluster.http.base_url)
        for number in range(2 * OPEN_FILES):
            cleanup.callback(connect(url, SENT[number % len(SENT)]).close)
        for path in ("/healthz", "/readyz", "/v1/jobs", "/healthz"):
            assert httpx.get(f"{url}{path}", timeout=DEADLINE_S).status_code == 200


@pytest.fixture
def start(redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., str]]:
    """Start a server with other limits."""
    with ExitStack() as cleanup:

        def run(limit: int = 1000, **seconds: float) -> str:
            for name, value in seconds.items():
                monkeypatch.setattr(connections, name, value)
            monkeypatch.setattr(connections, "connection_limit", lambda: limit)
            return cleanup.enter_context(serving(Settings(data_dir=tmp_path, redis_url=redis_url)))

        yield run


def test_a_connection_without_a_whole_header_is_closed(start: Callable[..., str], subtests: pytest.Subtests) -> None:
    url = start(HEADER_S=0.2, KEEP_ALIVE_S=0.2)
    for name, sent in {
        "nothing": b"",
        "half a header": HEADER,
        "half of the second header": HEADER + b"\r\n" + HEADER,
        "an empty line after a request": HEADER + b"\r\n\r\n",
    }.items():
        with subtests.test(name), connect(url, sent) as connection:
            assert received(connection).count(b"HTTP/1.1 200") == (b"\r\n\r\n" in sent)


def test_the_body_of_a_document_has_a_deadline_even_without_a_key(
    start: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(middleware, "IDLE_S", 0.2)
    head = b"POST /v1/webhooks HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\nContent-Length: 9\r\n\r\n{"
    with connect(start(), head) as connection:
        answer = received(connection)
    assert answer.startswith(b"HTTP/1.1 408 ")
    assert b"request_timeout" in answer


def test_a_body_that_nobody_reads_ends_with_its_connection(start: Callable[..., str]) -> None:
    """The response is complete, and what follows would keep the connection busy for as long as it drips."""
    head = b"POST /nothing HTTP/1.1\r\nHost: x\r\nContent-Length: 1000000000\r\n\r\n"
    with connect(start(DRAIN_S=0.2), head) as connection:
        assert connection.recv(12) == b"HTTP/1.1 404"
        connection.sendall(b"x")
        received(connection)


def test_a_response_that_nobody_reads_is_given_up(
    redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, lost = connections.LimitedProtocol.connection_lost, threading.Event()
    monkeypatch.setattr(connections, "DRAIN_S", 0.2)
    monkeypatch.setattr(connections.LimitedProtocol, "connection_lost", lambda *given: (real(*given), lost.set()))

    async def large(_: Request) -> Response:
        return Response(bytes(32 * 2**20))  # more than the buffers of the kernel

    with serving_app(Settings(data_dir=tmp_path, redis_url=redis_url)) as (url, app):
        app.add_route("/large", large)
        with connect(url, b"GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n"):
            assert lost.wait(DEADLINE_S)


def test_where_every_connection_is_in_use_a_new_one_is_refused(start: Callable[..., str]) -> None:
    url = start(limit=2)
    head = b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 9\r\n"
    with ExitStack() as cleanup:
        for _ in range(2):
            busy = cleanup.enter_context(connect(url, head + b"Expect: 100-continue\r\n\r\n"))
            assert busy.recv(12) == b"HTTP/1.1 100"
        with connect(url) as refused:
            answer = received(refused)
    assert answer.startswith(b"HTTP/1.1 503 ")
    assert json.loads(answer.partition(b"\r\n\r\n")[2])["code"] == "unavailable"
    assert httpx.get(f"{url}/healthz").status_code == 200
