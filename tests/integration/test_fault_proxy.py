"""The proxy that fails on demand does what it says; other tests rely on it."""

from __future__ import annotations

import socket
import socketserver
import threading
from collections.abc import Iterator

import httpx
import pytest

from tests.fault_proxy import FaultProxy


class Echo(socketserver.BaseRequestHandler):
    def handle(self) -> None:
        while part := self.request.recv(65_536):
            self.request.sendall(part)


@pytest.fixture
def proxy() -> Iterator[FaultProxy]:
    """In front of a server that sends back what it gets."""
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Echo) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        with FaultProxy(server.server_address[1]) as proxy:
            yield proxy
        server.shutdown()
        thread.join()


def connect(proxy: FaultProxy) -> socket.socket:
    return socket.create_connection(("127.0.0.1", proxy.port), timeout=10)


def exchange(connection: socket.socket, data: bytes) -> bytes:
    """Send, and read until as much is back or the other side ends."""
    back = b""
    try:
        connection.sendall(data)
        while len(back) < len(data) and (part := connection.recv(65_536)):
            back += part
    except ConnectionError:
        pass
    return back


def test_it_passes_bytes_both_ways(proxy: FaultProxy) -> None:
    data = bytes(range(256)) * 4000
    with connect(proxy) as one, connect(proxy) as two:
        assert exchange(one, b"first") == b"first"
        half = threading.Thread(target=one.sendall, args=(data,))
        half.start()
        back = b""
        while len(back) < len(data):
            back += one.recv(65_536)
        half.join()
        assert back == data
        assert exchange(two, b"second") == b"second"
        one.shutdown(socket.SHUT_WR)
        assert one.recv(1) == b""
    assert proxy.connections == 2


@pytest.mark.parametrize("upload", [False, True])
def test_it_cuts_after_a_number_of_bytes(proxy: FaultProxy, upload: bool) -> None:
    proxy.cut_after(100, upload=upload)
    with connect(proxy) as connection:
        back = exchange(connection, bytes(1000))
        assert len(back) <= 100
        assert upload or len(back) == 100
        with connect(proxy) as other:
            assert len(exchange(other, bytes(99))) == 99


def test_a_change_ends_what_is_open_and_keeps_the_port(proxy: FaultProxy) -> None:
    for change in (proxy.refuse, proxy.error503, lambda: proxy.cut_after(5), proxy.pass_through):
        proxy.pass_through()
        with connect(proxy) as connection:
            assert exchange(connection, b"x") == b"x"
            change()
            assert exchange(connection, b"x" * 10) == b""
    proxy.refuse()
    with pytest.raises(ConnectionRefusedError):
        connect(proxy)
    proxy.pass_through()
    with connect(proxy) as connection:
        assert exchange(connection, b"x") == b"x"


def test_it_answers_503_to_whatever_is_asked(proxy: FaultProxy) -> None:
    proxy.error503()
    url = f"http://127.0.0.1:{proxy.port}/"
    for method, content in (("GET", None), ("PUT", bytes(10_000_000))):
        assert httpx.request(method, url, content=content).status_code == 503


def test_it_hangs_old_connections_and_new_ones(proxy: FaultProxy) -> None:
    with connect(proxy) as old:
        assert exchange(old, b"x") == b"x"
        proxy.hang()
        with connect(proxy) as new:
            for connection in (old, new):
                connection.settimeout(0.2)
                with pytest.raises(TimeoutError):
                    exchange(connection, b"x")
                connection.settimeout(10)
            proxy.pass_through()
            assert exchange(old, b"") == b""
            with connect(proxy) as another:
                assert exchange(another, b"x") == b"x"
