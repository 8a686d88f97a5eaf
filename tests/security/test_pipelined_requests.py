"""Requests that follow each other without an end: how many of them, and how much of one, a server holds."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest

from meshdeform.serving.bounded_protocol import MAX_HEAD_BYTES, MAX_HEAD_LINES
from meshdeform.serving.connections import LimitedProtocol
from meshdeform.settings import Settings
from tests.acceptance.cluster import deployed
from tests.cases import each_case
from tests.integration.conftest import DEADLINE_S, serving
from tests.security.test_connections import connect, received

MIB = 2**20
ALIVE = b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n"
LAST = b"GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"
HEAD = ALIVE[:-2]
SHORT = b"GET / HTTP/1.1\r\n\r\n"
CHUNKED = b"POST /v1/webhooks HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n1\r\n{\r\n"
LINE = b"X-a: b\r\n"
ENDLESS = {
    "a line too many": HEAD + LINE * MAX_HEAD_LINES + b"\r\n",
    "many lines": HEAD + LINE * 20_000,
    "a value": HEAD + b"X-a: " + b"b" * MIB,
    "a name": HEAD + b"X" * MIB,
    "blanks": HEAD + b"X-a: " + b" " * MIB,
    "a path": b"GET /" + b"a" * MIB,
    "a method": b"G" * MIB,
    "empty lines": b"\r\n" * MIB,
    "trailers": CHUNKED + b"0\r\n" + LINE * 20_000,
    "a trailer": CHUNKED + b"0\r\nX-a: " + b"b" * MIB,
    "an extension of a chunk": CHUNKED + b"1;" + b"b" * MIB,
}
"""What goes on for longer than a request's head may."""


@pytest.fixture(scope="module")
def url(redis_server_url: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server that all tests of the file share."""
    with serving(Settings(data_dir=tmp_path_factory.mktemp("api"), redis_url=redis_server_url)) as found:
        yield found


def push(connection: socket.socket, data: bytes) -> int:
    """Send until the other side takes no more; return the number of bytes that it took."""
    connection.settimeout(1.0)
    sent = 0
    try:
        while sent < len(data):
            sent += connection.send(data[sent : sent + 65_536])
    except OSError:
        pass
    connection.settimeout(DEADLINE_S)
    return sent


def answers(connection: socket.socket, sent: bytes) -> list[int]:
    """Send something while reading what comes back, until the server closes the connection; return the statuses."""
    sender = threading.Thread(target=lambda: push(connection, sent))
    sender.start()
    got = received(connection)
    sender.join()
    return [int(each[:3]) for each in got.split(b"HTTP/1.1 ")[1:]]


def problem(connection: socket.socket) -> tuple[int, str]:
    """Return the status and the code of the only answer on a connection."""
    head, _, body = received(connection).partition(b"\r\n\r\n")
    return int(head.split()[1]), json.loads(body)["code"]


def test_no_attack_leaves_more_in_memory(tmp_path: Path, subtests: pytest.Subtests) -> None:
    with deployed(tmp_path) as cluster:
        process = psutil.Process(cluster.start_api().pid)
        stream = f"GET /v1/jobs/{cluster.submit()}/events HTTP/1.1\r\nHost: x\r\n\r\n".encode()
        alive = ALIVE * (16 * MIB // len(ALIVE))
        for attack, sent in {
            "answers that nobody reads": [alive],
            "a stream that goes on": [stream + alive],
            "headers without an end": [HEAD + LINE * (8 * MIB // len(LINE))] * 4,
            "a long line": [HEAD + b"X-a: " + b"b" * 16 * MIB] * 4,
        }.items():
            with subtests.test(attack), ExitStack() as cleanup:
                before = process.memory_info().rss
                for each in sent:
                    connection = cleanup.enter_context(connect(str(cluster.http.base_url)))
                    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                    push(connection, each)
                assert cluster.http.get("/healthz").status_code == 200
                assert process.memory_info().rss - before < 50 * MIB


def test_few_requests_wait_on_a_connection_and_each_has_its_answer(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    waiting: list[int] = []
    real = LimitedProtocol.on_headers_complete

    def counted(protocol: LimitedProtocol) -> None:
        real(protocol)
        waiting.append(len(protocol.pipeline))

    monkeypatch.setattr(LimitedProtocol, "on_headers_complete", counted)
    with connect(url) as connection:
        assert answers(connection, SHORT * 3000 + LAST) == [400] * 3000 + [200]
    assert 1 < max(waiting) <= 100


def test_bodies_of_pipelined_requests_are_read(url: str) -> None:
    body = b'{"url": "https://example.org/' + b"x" * 150_000 + b'"}'
    post = b"POST /v1/webhooks HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\nContent-Length: %d\r\n\r\n%b"
    with connect(url) as connection:
        found = answers(connection, (ALIVE + post % (len(body), body)) * 20 + LAST)
    assert found == [200, 401] * 20 + [200]


@each_case("name", ENDLESS)
def test_a_head_without_an_end_is_refused(url: str, name: str) -> None:
    with connect(url) as connection:
        push(connection, ENDLESS[name])
        assert problem(connection) == ((400, "request_invalid") if name == "a method" else (431, "headers_too_large"))


def test_a_head_that_drips_is_refused(url: str) -> None:
    with connect(url) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for byte in HEAD + LINE * (MAX_HEAD_LINES + 1):
            connection.send(bytes([byte]))
        assert problem(connection) == (431, "headers_too_large")


def test_a_head_within_the_limits_is_taken(url: str) -> None:
    lines = [b"X-%d: %b\r\n" % (number, b"a" * 600) for number in range(MAX_HEAD_LINES - 1)]
    head = HEAD + b"".join(lines) + b"\r\n"
    assert MAX_HEAD_BYTES * 0.9 < len(head) < MAX_HEAD_BYTES
    with connect(url) as connection:
        assert answers(connection, head + LAST) == [200, 200]


def test_what_follows_good_requests_is_refused_after_their_answers(url: str) -> None:
    with connect(url) as connection:
        assert answers(connection, ALIVE * 50 + b"no HTTP\r\n\r\n" + ALIVE) == [200] * 50 + [400]


def test_a_waiting_request_whose_body_is_broken_is_refused_in_its_turn(url: str) -> None:
    with connect(url) as connection:
        assert answers(connection, ALIVE * 9 + CHUNKED + b"no length\r\n") == [200] * 9 + [400]


@each_case("hosts", [b"", b"Host: x\r\nHost: y\r\n"])
def test_a_request_has_one_host(url: str, hosts: bytes) -> None:
    with connect(url, b"GET /healthz HTTP/1.1\r\n" + hosts + b"Connection: close\r\n\r\n") as connection:
        assert problem(connection) == (400, "request_invalid")


def test_a_request_of_http_1_0_needs_no_host(url: str) -> None:
    with connect(url, b"GET /healthz HTTP/1.0\r\n\r\n") as connection:
        assert received(connection).startswith(b"HTTP/1.1 200 ")
