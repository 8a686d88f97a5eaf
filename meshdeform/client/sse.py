"""Parse server-sent events from bytes that arrive in pieces.

Source: the HTML standard, "Interpreting an event stream".
"""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from dataclasses import dataclass

from meshdeform.errors import UnavailableError

__all__ = ["Parser", "ServerEvent"]

_LONGEST = 16 * 2**20


@dataclass(frozen=True)
class ServerEvent:
    """A server-sent event.

    Attributes
    ----------
    type : str
        `message` if the stream names none.
    data : str
    id : str
        The last id that the stream sent; empty before the first.
    """

    type: str
    data: str
    id: str


class Parser:
    """Converts bytes to events. An event that is cut off is discarded."""

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8-sig")("replace")
        self._line: list[str] = []
        self._pending, self._after_return = 0, False
        self._type, self._data, self._id = "", list[str](), ""

    def feed(self, data: bytes) -> Iterator[ServerEvent]:
        """Yield the events that these bytes complete.

        Raises
        ------
        UnavailableError
            An event is too long, so that this is not a stream of events.
        """
        text = self._decoder.decode(data)
        if self._after_return and text:
            # The previous line ended with the CR of this CR LF.
            text = text.removeprefix("\n")
            self._after_return = False
        if text.endswith("\r"):
            self._after_return = True
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        for line in lines[:-1]:
            whole = "".join([*self._line, line])
            self._line = []
            if event := self._take(whole):
                yield event
        if lines[-1]:
            self._line.append(lines[-1])
            self._pending += len(lines[-1])
        if self._pending > _LONGEST:
            raise UnavailableError("The stream of events has an event without an end.", advice="Report this.")

    def _take(self, line: str) -> ServerEvent | None:
        if not line:
            kind, lines = self._type or "message", self._data
            self._type, self._data, self._pending = "", [], 0
            return ServerEvent(kind, "\n".join(lines), self._id) if lines else None
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "event":
            self._type = value
        elif name == "data":
            self._data.append(value)
            self._pending += len(value)
        elif name == "id" and "\0" not in value:
            self._id = value
        return None
