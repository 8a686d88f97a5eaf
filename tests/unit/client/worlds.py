"""A service that answers from a list, and pauses that take no time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import httpx
import pytest

from meshdeform.api.jobs import EventView
from meshdeform.client.requests import Answer, Call, Endpoint
from meshdeform.client.retries import Policy
from meshdeform.client.sync.connection import Connection
from meshdeform.client.sync.transfers import followed

T = TypeVar("T")
Reply = Answer | Exception | list[Any] | Callable[[httpx.Request], Answer]


def answer(status: int = 200, content: bytes | str = b"", **headers: str) -> Answer:
    """An answer with headers; `_` in their names stands for `-`."""
    body = content.encode() if isinstance(content, str) else content
    named = httpx.Headers({name.replace("_", "-"): text for name, text in headers.items()})
    return Answer(status, "http://x/y", named, body)


class World(httpx.BaseTransport):
    """A service that gives its replies one by one, and the connection to it.

    A list gives the parts of a stream of events; an exception, in it or in its place, is raised instead.
    """

    def __init__(self, *replies: Reply, policy: Policy) -> None:
        self.replies = list(replies)
        self.requests: list[httpx.Request] = []
        self.pauses: list[float] = []
        self.connection = Connection(httpx.Client(transport=self), Endpoint("http://x"), policy)

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        self.requests.append(request)
        reply = self.replies.pop(0)
        if callable(reply):
            reply = reply(request)
        if isinstance(reply, Exception):
            raise reply
        if isinstance(reply, list):
            return httpx.Response(200, headers={"content-type": "text/event-stream"}, stream=_Parts(reply))
        return httpx.Response(reply.status, headers=reply.headers, content=reply.content)

    def answered(self, call: Call) -> Answer:
        """Send a request with retries."""
        return self._without_pauses(lambda: self.connection.answered(call))

    def watched(self, after: int) -> list[EventView]:
        """Follow the events of a job to the last."""
        return self._without_pauses(lambda: list(followed(self.connection, "job_1", after)))

    def _without_pauses(self, operation: Callable[[], T]) -> T:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(time, "sleep", self.pauses.append)
            return operation()


class _Parts(httpx.SyncByteStream):
    def __init__(self, parts: list[Any]) -> None:
        self._parts = parts

    def __iter__(self) -> Iterator[bytes]:
        for part in self._parts:
            if isinstance(part, Exception):
                raise part
            yield part
