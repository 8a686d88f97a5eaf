"""A TCP proxy on loopback that fails on demand: in front of an object store, a PostgreSQL, a Redis."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from types import TracebackType

__all__ = ["FaultProxy"]


def _page(status: str, kind: str, body: bytes) -> bytes:
    head = f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    return head.encode() + body


def _refusal(status: str, code: str) -> bytes:
    return _page(status, "application/xml", f'<?xml version="1.0"?><Error><Code>{code}</Code></Error>'.encode())


_ANSWERS = {
    "error503": _page("503 Service Unavailable", "text/plain", b""),
    # What a gateway says that has lost the way to its server.
    "error404": _page("404 Not Found", "text/html", b"<html>No such page</html>"),
    "error403": _refusal("403 Forbidden", "AccessDenied"),
    "no_bucket": _refusal("404 Not Found", "NoSuchBucket"),
}


class FaultProxy:
    """Stands in front of a server; a context manager. It passes everything on until it is told otherwise.

    A change of the mode ends the connections of the mode before (except that `hang` lets them stand), so that no pool
    goes on with an old one. `port` is the same in every mode; `connections` counts those accepted so far.
    """

    def __init__(self, target_port: int) -> None:
        self._target = target_port
        self._mode, self._limit, self._upload = "pass", 0, False
        self._changed = threading.Condition()
        self._epoch = 0
        self._open: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._listener: socket.socket | None = None
        self.port, self.connections = 0, 0

    def __enter__(self) -> FaultProxy:
        self._listen()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._switch("refuse")
        for thread in self._threads:
            thread.join(timeout=240)

    def pass_through(self) -> None:
        """Be as if not there."""
        self._switch("pass")

    def error503(self) -> None:
        """Answer every HTTP request with 503, and ask nobody."""
        self._switch("error503")

    def error404(self) -> None:
        """Answer every HTTP request with a page that says 404, and ask nobody."""
        self._switch("error404")

    def error403(self) -> None:
        """Answer every HTTP request as S3 does whose keys have been taken away, and ask nobody."""
        self._switch("error403")

    def no_bucket(self) -> None:
        """Answer every HTTP request as S3 does without the bucket, and ask nobody."""
        self._switch("no_bucket")

    def lead_to(self, target_port: int) -> None:
        """Pass everything on to another server from now on."""
        self._target = target_port
        self._switch("pass")

    def cut_after(self, count: int, *, upload: bool = False) -> None:
        """Pass `count` bytes of each connection, of the answers or (`upload`) of the requests, then end it."""
        self._switch("cut", count, upload)

    def refuse(self) -> None:
        """Listen no more: connections are refused."""
        self._switch("refuse")

    def hang(self) -> None:
        """Accept connections, and pass nothing on, on those that are open either."""
        self._switch("hang")

    def _switch(self, mode: str, limit: int = 0, upload: bool = False) -> None:
        with self._changed:
            self._mode, self._limit, self._upload = mode, limit, upload
            self._epoch += 1
            if mode != "hang":
                for connection in list(self._open):
                    _shut(connection)
            self._changed.notify_all()
        if mode == "refuse" and self._listener is not None:
            listener, self._listener = self._listener, None
            _shut(listener)  # wakes `accept`, which closing alone does not
            listener.close()
        elif mode != "refuse" and self._listener is None:
            self._listen()

    def _listen(self) -> None:
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", self.port))
        listener.listen(128)
        self.port = int(listener.getsockname()[1])
        self._listener = listener
        self._start(self._accept, listener)

    def _start(self, work: Callable[..., None], *arguments: object) -> None:
        thread = threading.Thread(target=work, args=arguments, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = listener.accept()
                self.connections += 1
                self._start(self._serve, client)

    def _serve(self, client: socket.socket) -> None:
        with self._tracked(client):
            if self._hung():
                return
            mode = self._mode
            with contextlib.suppress(OSError):
                if mode in _ANSWERS:
                    _answer(client, _ANSWERS[mode])
                elif mode != "refuse":
                    self._connect(client)

    def _connect(self, client: socket.socket) -> None:
        with socket.create_connection(("127.0.0.1", self._target), timeout=240) as server, self._tracked(server):
            server.settimeout(None)
            with self._changed:
                limit = self._limit if self._mode == "cut" else None
                up, down = (limit, None) if self._upload else (None, limit)
            upwards = threading.Thread(target=self._pump, args=(client, server, up), daemon=True)
            upwards.start()
            self._pump(server, client, down)
            upwards.join()

    def _pump(self, source: socket.socket, sink: socket.socket, left: int | None) -> None:
        """Pass bytes on until either side ends, or the count is used up."""
        with contextlib.suppress(OSError):
            while part := source.recv(65_536):
                if self._hung():
                    break
                if left is not None:
                    part = part[:left]
                    left -= len(part)
                sink.sendall(part)
                if left == 0:
                    break
            else:
                # The source has nothing more to say; the other direction may.
                sink.shutdown(socket.SHUT_WR)
                return
        _shut(source)
        _shut(sink)

    def _hung(self) -> bool:
        """Whether the mode was to hang; returns when it is no more."""
        with self._changed:
            epoch = self._epoch
            if self._mode != "hang":
                return False
            self._changed.wait_for(lambda: self._epoch != epoch)
            return True

    @contextlib.contextmanager
    def _tracked(self, connection: socket.socket) -> Iterator[None]:
        with self._changed:
            self._open.add(connection)
        try:
            yield
        finally:
            with self._changed:
                self._open.discard(connection)
            connection.close()


def _answer(client: socket.socket, answer: bytes) -> None:
    head = b""
    while b"\r\n\r\n" not in head:
        part = client.recv(65_536)
        if not part:
            return
        head += part
    client.sendall(answer)
    client.shutdown(socket.SHUT_WR)
    # The rest of the request: closing with bytes unread would reset the connection, and the answer be lost.
    while client.recv(65_536):
        pass


def _shut(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
