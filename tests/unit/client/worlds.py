"""A service that answers from a list, for the sync and the async client alike, and pauses that take no time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from typing import Any, TypeVar

import httpx

from meshdeform.client.commands import Answer, Callback, Emit, Operation, Pause, Read, Send, Shield, Stream, Work

T = TypeVar("T")
Reply = Answer | Exception | Callable[[Any], Any]


def answer(status: int = 200, content: bytes | str = b"", **headers: str) -> Answer:
    """An answer with headers; `_` in their names stands for `-`."""
    body = content.encode() if isinstance(content, str) else content
    named = httpx.Headers({name.replace("_", "-"): text for name, text in headers.items()})
    return Answer(status, "http://x/y", named, body)


class World:
    """Carries out an operation with answers from a list; the driver of the unit tests.

    Parameters
    ----------
    *replies : Answer, exception, callable or list of bytes
        For each `Send` or `Stream` one. A list gives the parts of the stream that it opens; an exception in it is
        raised by `Read`.
    """

    def __init__(self, *replies: Any) -> None:
        self.replies = list(replies)
        self.calls: list[Any] = []
        self.pauses: list[float] = []
        self._parts: Iterator[Any] = iter(())

    def run(self, operation: Operation[T]) -> tuple[list[Any], T]:
        """Return what was emitted, and the result."""
        emitted: list[Any] = []
        steps = self._steps(operation)
        while True:
            try:
                emitted.append(next(steps))
            except StopIteration as end:
                return emitted, end.value

    def _steps(self, operation: Operation[T]) -> Generator[Any, None, T]:
        value: Any = None
        error: BaseException | None = None
        while True:
            try:
                command = operation.send(value) if error is None else operation.throw(error)
            except StopIteration as end:
                result: T = end.value
                return result
            value = error = None
            if isinstance(command, Emit):
                yield command.item
                continue
            try:
                value = self._do(command)
            except BaseException as raised:
                error = raised

    def _do(self, command: Any) -> Any:
        match command:
            case Send(call):
                self.calls.append(call)
                return _given(self.replies.pop(0), call)
            case Stream(call):
                self.calls.append(call)
                reply = self.replies.pop(0)
                if isinstance(reply, list):
                    self._parts = iter(reply)
                    return answer(200, content_type="text/event-stream")
                return _given(reply, call)
            case Read():
                part = next(self._parts, b"")
                if isinstance(part, BaseException):
                    raise part
                return part
            case Pause(seconds):
                self.pauses.append(seconds)
                return None
            case Work(function):
                return function()
            case Callback(function, argument):
                return function(argument)
            case Shield(operation, _):
                return self.run(operation)[1]
        raise AssertionError(command)


def _given(reply: Any, call: Any) -> Any:
    if isinstance(reply, BaseException):
        raise reply
    return reply(call) if callable(reply) else reply
