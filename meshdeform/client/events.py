"""Read a job's events from server-sent events, in bytes that arrive in pieces.

Source of the parser: the HTML standard, "Interpreting an event stream".
"""

from __future__ import annotations

import codecs
import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from meshdeform.api.jobs import EventView
from meshdeform.client.documents import read
from meshdeform.client.problems import error_of
from meshdeform.client.requests import Answer, Call, job_path
from meshdeform.errors import MeshdeformError, UnavailableError

_LONGEST = 16 * 2**20


@dataclass(frozen=True)
class ServerEvent:
    """A server-sent event: its type, `message` if the stream names none; its data; the last id that the stream sent."""

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
        """Yield the events that these bytes complete."""
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


def events_call(job_id: str, after: int, silence_s: float) -> Call:
    """Return the request for the events after a number, on a connection that may be silent for some seconds."""
    headers = {"Accept": "text/event-stream", "Accept-Encoding": "identity", "Last-Event-ID": str(after)}
    return Call("GET", job_path(job_id, "events"), headers=headers, read_timeout_s=max(silence_s, 0.01))


class EventStream:
    """The events of one connection."""

    def __init__(self, job_id: str, answer: Answer) -> None:
        if not answer.ok:
            raise error_of(answer)
        if not answer.headers.get("content-type", "").startswith("text/event-stream"):
            raise MeshdeformError(f"{answer.url} is not a stream of events.", advice="Check the service's address.")
        self._job_id, self._url = job_id, answer.url
        self._parser, self._since = Parser(), time.monotonic()

    @property
    def age_s(self) -> float:
        """Seconds since the connection was made."""
        return time.monotonic() - self._since

    def feed(self, data: bytes) -> list[EventView]:
        """Return the events that these bytes complete, without those of a form that only newer services send."""
        events = [self._event(event) for event in self._parser.feed(data)]
        return [event for event in events if event is not None]

    def _event(self, received: ServerEvent) -> EventView | None:
        try:
            document: Any = json.loads(received.data)
        except ValueError:
            return None
        if not isinstance(document, dict) or "seq" not in document:
            return None
        return read(EventView, {"job_id": self._job_id, **document}, self._url)


class EventOrder:
    """The order of a job's events over all connections, from the one after a number."""

    def __init__(self, after: int) -> None:
        self.after = after  # the number of the last event
        self.missing = False  # whether the next one is missing, and is to be requested once more
        self._doubted = -1

    def accepted(self, events: Iterable[EventView]) -> Iterator[EventView]:
        """Yield those of the events that come next. One that is missing even when requested again is passed over."""
        self.missing = False
        for event in events:
            if event.seq <= self.after:
                continue
            if event.seq > self.after + 1 and self._doubted != self.after:
                self._doubted, self.missing = self.after, True
                return
            self.after = event.seq
            yield event
