"""Limit the API's connections: their number, and how long a client may hold one without sending or reading anything.

A connection is idle while no request is being served on it. When the limit is reached, a new connection replaces the
oldest idle one, so that idle connections can never keep others out.
"""

from __future__ import annotations

import asyncio
import resource
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from meshdeform.errors import UnavailableError
from meshdeform.serving.bounded_protocol import BoundedProtocol, refusal

if TYPE_CHECKING:
    from meshdeform.settings import Settings

HEADER_S = 15.0
"""Maximum time from the start of a connection, or from the first byte of another request, to the end of its header."""

DRAIN_S = 60.0
"""Maximum time to receive the rest of a body that was not read, and to send the rest of a response."""

# Longer than clients and proxies keep idle connections, so that they close them and never meet a closed one.
KEEP_ALIVE_S = 75
_MOST_OPEN_FILES = 16_384
_UNLIMITED = 8192
_REFUSAL = refusal(
    UnavailableError("The server has too many connections.", advice="Try again in a moment."),
    headers="Retry-After: 2\r\n",
)


@dataclass
class _Idle:
    """The idle connections of a server, the oldest first: those without any request so far, and the others."""

    limit: int
    fresh: dict[LimitedProtocol, None] = field(default_factory=dict)
    kept: dict[LimitedProtocol, None] = field(default_factory=dict)


def raise_open_files() -> None:
    """Raise this process's limit of open files, within the system's hard limit. Its usual default is only 1024."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = _MOST_OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, _MOST_OPEN_FILES)
    if soft != resource.RLIM_INFINITY and soft < limit:
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))


def connection_limit() -> int:
    """Return the maximum number of connections: half of the files that this process may open."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return _UNLIMITED if soft == resource.RLIM_INFINITY else max(1, soft // 2)


def http_options(settings: Settings) -> dict[str, Any]:
    """Return the options of uvicorn's configuration that concern HTTP."""
    return {
        "http": LimitedProtocol,
        "ws": "none",
        "proxy_headers": bool(settings.trusted_proxies),
        "forwarded_allow_ips": settings.trusted_proxies,
        # uvicorn's access log contains query strings, which may hold signatures.
        "access_log": False,
        "server_header": False,
        "timeout_keep_alive": KEEP_ALIVE_S,
    }


class LimitedProtocol(BoundedProtocol):
    """The bounded HTTP protocol with a limit of connections, and timeouts for headers and for clients that stall."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept a connection, if necessary in place of the oldest idle one."""
        super().connection_made(transport)
        self._deadline: asyncio.TimerHandle | None = None
        self._stalled: asyncio.TimerHandle | None = None
        state = vars(self.server_state)
        self._idle: _Idle = state.setdefault("idle_connections", _Idle(connection_limit()))
        self._idle.fresh[self] = None
        self._expire_after(HEADER_S)
        if len(self.connections) > self._idle.limit:
            self._make_room()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._set_busy()
        self.resume_writing()
        super().connection_lost(exc)

    def _feed(self, piece: bytes) -> None:
        """Parse received data. On an idle connection they start the time for the next header."""
        super()._feed(piece)
        if self._is_idle and self._deadline is None:
            draining = self.cycle is not None and self.cycle.more_body
            self._expire_after(DRAIN_S if draining else HEADER_S)

    def on_headers_complete(self) -> None:
        """Start a request."""
        self._set_busy()
        super().on_headers_complete()

    def on_response_complete(self) -> None:
        """Keep the connection for further requests, and do not wait forever for its client to read the response."""
        super().on_response_complete()
        if self.cycle.response_complete:
            self._idle.kept[self] = None
            if self.transport.is_closing():
                self._expire_after(DRAIN_S)

    def timeout_keep_alive_handler(self) -> None:
        """Close an idle connection."""
        self._drop()

    def pause_writing(self) -> None:
        """Stop sending to a client that does not read."""
        super().pause_writing()
        self._stalled = self.loop.call_later(DRAIN_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Continue sending."""
        super().resume_writing()
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None

    @property
    def _is_idle(self) -> bool:
        return self in self._idle.fresh or self in self._idle.kept

    def _set_busy(self) -> None:
        self._idle.fresh.pop(self, None)
        self._idle.kept.pop(self, None)
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _expire_after(self, seconds: float) -> None:
        self._deadline = self.loop.call_later(seconds, self._drop)

    def _drop(self) -> None:
        self._set_busy()
        if self.transport.get_write_buffer_size():
            self.transport.abort()  # `close` would wait until the client has read everything
        else:
            self.transport.close()

    def _make_room(self) -> None:
        # Connections that were never used first, then those that wait for another request.
        oldest = next(iter(self._idle.fresh))
        if oldest is self:
            oldest = next(iter(self._idle.kept), self)
        if oldest is not self:
            oldest._drop()
            return
        self._set_busy()
        self.transport.write(_REFUSAL)
        self.transport.close()
