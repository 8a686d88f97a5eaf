"""Connect to the checked addresses of a host, whatever its name resolves to by then."""

from __future__ import annotations

import ssl
import time
from collections.abc import Callable
from typing import Any

import httpcore

__all__ = ["CONNECT_S", "PinnedAsyncNetwork", "PinnedNetwork", "Track", "network_error"]

CONNECT_S = 5.0
"""Seconds to connect to a host."""
Track = Callable[[httpcore.NetworkStream | None, httpcore.NetworkStream | None], None]
"""Is told of the stream that replaces another; raises `ConnectError` if there shall be none."""


class PinnedNetwork(httpcore.NetworkBackend):
    """A network in which every name resolves to one host's checked addresses, until a deadline."""

    def __init__(self, addresses: tuple[str, ...], connect_s: float, deadline: float, track: Track) -> None:
        self._addresses, self._connect_s, self._track = addresses, connect_s, track
        self.deadline = deadline
        self.stream: httpcore.NetworkStream | None = None

    def connect_tcp(
        self,
        host: str,  # noqa: ARG002 - already resolved
        port: int,
        timeout: float | None = None,  # noqa: ARG002
        local_address: str | None = None,
        socket_options: Any = None,
    ) -> httpcore.NetworkStream:
        """Connect to the first of the addresses that answers; they share the time."""
        until = min(time.monotonic() + self._connect_s, self.deadline)
        failed: Exception = httpcore.ConnectTimeout("No time was left to connect.")
        for number, address in enumerate(self._addresses):
            # Share the time, so that an address that never answers leaves some for the others.
            share = (until - time.monotonic()) / (len(self._addresses) - number)
            if share <= 0:
                break
            try:
                stream = httpcore.SyncBackend().connect_tcp(address, port, share, local_address, socket_options)
            except (httpcore.ConnectError, httpcore.ConnectTimeout) as error:
                failed = error
                continue
            return self.replace(stream)
        raise failed

    def replace(self, stream: httpcore.NetworkStream) -> httpcore.NetworkStream:
        """Replace the current stream."""
        try:
            self._track(self.stream, stream)
        except httpcore.ConnectError:
            stream.close()
            raise
        self.stream = stream
        return _TimedStream(stream, self)


class PinnedAsyncNetwork(httpcore.AsyncNetworkBackend):
    """The same for asyncio; whoever uses it sets the deadline."""

    def __init__(self, addresses: tuple[str, ...]) -> None:
        self._addresses = addresses

    async def connect_tcp(
        self,
        host: str,  # noqa: ARG002 - already resolved
        port: int,
        timeout: float | None = None,  # noqa: ARG002 - httpcore's signature
        local_address: str | None = None,
        socket_options: Any = None,
    ) -> httpcore.AsyncNetworkStream:
        """Connect to the first of the addresses that answers; they share the time."""
        failed: Exception = httpcore.ConnectTimeout("No time was left to connect.")
        share = CONNECT_S / len(self._addresses)
        for address in self._addresses:
            try:
                return await httpcore.AnyIOBackend().connect_tcp(address, port, share, local_address, socket_options)
            except (httpcore.ConnectError, httpcore.ConnectTimeout) as error:
                failed = error
        raise failed


class _TimedStream(httpcore.NetworkStream):
    """A connection that ends at a deadline, even if data keeps arriving."""

    def __init__(self, stream: httpcore.NetworkStream, network: PinnedNetwork) -> None:
        self._stream, self._network = stream, network

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:  # noqa: ARG002
        return self._stream.read(max_bytes, self._left(httpcore.ReadTimeout))

    def write(self, buffer: bytes, timeout: float | None = None) -> None:  # noqa: ARG002
        self._stream.write(buffer, self._left(httpcore.WriteTimeout))

    def close(self) -> None:
        self._stream.close()

    def start_tls(
        self,
        ssl_context: ssl.SSLContext,
        server_hostname: str | None = None,
        timeout: float | None = None,  # noqa: ARG002
    ) -> httpcore.NetworkStream:
        left = self._left(httpcore.ConnectTimeout)
        return self._network.replace(self._stream.start_tls(ssl_context, server_hostname, left))

    def get_extra_info(self, info: str) -> Any:
        return self._stream.get_extra_info(info)

    def _left(self, over: type[Exception]) -> float:
        left = self._network.deadline - time.monotonic()
        if left <= 0:
            raise over("The deadline has passed.")
        return left


def network_error(error: Exception, other: str) -> str:
    """Return a sentence about a connection to the `other` side that failed, without its addresses."""
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, ssl.SSLCertVerificationError):
            return f"The {other}'s certificate is not valid: {seen.verify_message}."
        if isinstance(seen, ssl.SSLError):
            return f"The TLS connection to the {other} failed."
        seen = seen.__cause__ or seen.__context__
    return "The connection failed."
