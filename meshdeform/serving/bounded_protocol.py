"""Bound what one HTTP connection can make the server hold: requests that wait for their turn, and headers.

Requests may follow each other without waiting for the answers (pipelining). uvicorn keeps those that are read, and
reads on after each answer, however many still wait; its parser keeps a header of any length. Here data is parsed in
small pieces, and only while no request waits; the rest stays with the client. Headers have a largest size and number.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from http import HTTPStatus
from typing import cast

from uvicorn.protocols.http.flow_control import HIGH_WATER_LIMIT, FlowControl
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from meshdeform.errors import HeadersTooLargeError, MeshdeformError, RequestError

MAX_HEAD_BYTES = 65_536
"""Maximum bytes of a request's first line and headers; also of anything else that is neither these nor a body."""

MAX_HEAD_LINES = 100
"""Maximum number of a request's headers, with those after a chunked body."""

# Small enough that the requests in one are few, and large enough that a body is not slowed down.
_PIECE_BYTES = 1024

_LINGER_S = 5.0
"""How long a refused client may go on sending, unheard: if it were cut off at once, it might not get the refusal."""


def refusal(error: MeshdeformError, status: int = 0, headers: str = "") -> bytes:
    """Return a whole HTTP response that says the error and closes the connection."""
    status = status or error.status
    body = json.dumps(
        {
            "type": f"urn:meshdeform:problem:{error.code}",
            "title": error.title,
            "status": status,
            "detail": error.detail,
            "code": error.code,
            "advice": error.advice_text,
        }
    ).encode()
    head = (
        f"HTTP/1.1 {status} {HTTPStatus(status).phrase}\r\nContent-Type: application/problem+json\r\n"
        f"Content-Length: {len(body)}\r\n{headers}Connection: close\r\n\r\n"
    )
    return head.encode() + body


_TOO_LARGE = refusal(
    HeadersTooLargeError(f"The headers have more than {MAX_HEAD_BYTES // 1024} KiB or {MAX_HEAD_LINES} lines.")
)
_NO_HTTP = refusal(
    RequestError("This is not a valid HTTP request.", advice="Send the request with an HTTP client."), status=400
)


class _PatientFlow(FlowControl):
    """Flow control that asks whether to go on reading."""

    def __init__(self, transport: asyncio.Transport, ready: Callable[[], bool]) -> None:
        super().__init__(transport)
        self._ready = ready

    def resume_reading(self) -> None:
        """Go on reading, or leave that to whoever is not ready."""
        if self.read_paused and self._ready():
            super().resume_reading()


class BoundedProtocol(HttpToolsProtocol):
    """uvicorn's HTTP protocol that reads no more requests while some wait, and refuses headers without an end."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept a connection."""
        super().connection_made(cast("asyncio.Transport", transport))
        self.flow = _PatientFlow(self.transport, self._ready)
        self._unparsed = bytearray()
        self._silent_bytes = self._head_lines = self._unanswered = 0
        self._understood = False
        self._refusal = b""
        self._lingering: asyncio.TimerHandle | None = None

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._unparsed.clear()
        if self._lingering is not None:
            self._lingering.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse received data, as far as no request waits."""
        if not self._refusal:
            self._unparsed += data
            self._parse()

    def on_message_begin(self) -> None:
        """Start a request's head."""
        super().on_message_begin()
        self._head_lines = 0

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take a header, or end the parsing."""
        self._head_lines += 1
        if self._head_lines > MAX_HEAD_LINES:
            raise HeadersTooLargeError("too many lines")
        super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Start a request, or let it wait."""
        self._understood = True
        super().on_headers_complete()
        self._unanswered += 1

    def on_body(self, body: bytes) -> None:
        """Take a piece of a body."""
        self._understood = True
        super().on_body(body)

    def on_message_complete(self) -> None:
        """End a request."""
        self._understood = True
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """Start the next request; after the last answer, say what was wrong with the data after its request."""
        self._unanswered -= 1
        super().on_response_complete()
        self._say_refusal()

    def send_400_response(self, msg: str) -> None:
        """Refuse what the parser did not understand, or did not want."""
        del msg
        self._refuse(_TOO_LARGE if self._head_lines > MAX_HEAD_LINES else _NO_HTTP)

    def _feed(self, piece: bytes) -> None:
        """Parse one piece of data."""
        self._understood = False
        super().data_received(piece)
        # In pieces, as nothing is told of a header before its end, and nothing at all of what is skipped.
        self._silent_bytes = 0 if self._understood else self._silent_bytes + len(piece)
        if self._silent_bytes > MAX_HEAD_BYTES and not self._refusal:
            self._refuse(_TOO_LARGE)

    def _parse(self) -> None:
        while self._unparsed and not self._is_behind:
            piece = bytes(self._unparsed[:_PIECE_BYTES])
            del self._unparsed[:_PIECE_BYTES]
            self._feed(piece)
        if not self._is_behind:
            self.flow.resume_reading()

    @property
    def _is_behind(self) -> bool:
        """Whether something must be done with what is parsed before more is."""
        if self.pipeline or self._refusal or self.transport.is_closing():
            return True
        cycle = self.cycle
        return cycle is not None and not cycle.response_complete and len(cycle.body) > HIGH_WATER_LIMIT

    def _ready(self) -> bool:
        if self.pipeline or self._refusal:
            return False
        if self._unparsed:
            # Not now: the caller is in the midst of ending an answer, or of taking a body.
            self.loop.call_soon(self._parse)
            return False
        return True

    def _refuse(self, answer: bytes) -> None:
        """Parse nothing more, and send this answer after those to the requests that were whole."""
        self._refusal = answer
        self._unparsed.clear()
        cycle = self.cycle
        if cycle is not None and cycle.more_body and not cycle.response_complete:
            self._unanswered -= 1
            if self.pipeline:
                self.pipeline.popleft()
            else:
                cycle.disconnected = True
                cycle.message_event.set()
                if cycle.response_started:
                    self.transport.close()
        self._say_refusal()

    def _say_refusal(self) -> None:
        if not self._refusal or self._unanswered or self._lingering is not None or self.transport.is_closing():
            return
        self._lingering = self.loop.call_later(_LINGER_S, self.transport.abort)
        self.transport.write(self._refusal)
        if self.transport.can_write_eof():
            self.transport.write_eof()
            FlowControl.resume_reading(self.flow)
        else:
            self.transport.close()
