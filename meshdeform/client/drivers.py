"""Execute the commands of an operation, with one driver for threads and one for event loops."""

from __future__ import annotations

import inspect
import time
from collections.abc import AsyncGenerator, AsyncIterator, Generator, Iterator
from types import TracebackType
from typing import Any, Self, TypeVar

import anyio
import httpx

from meshdeform.client.commands import (
    Answer,
    Call,
    Callback,
    Command,
    Emit,
    Operation,
    Pause,
    Read,
    Send,
    Shield,
    Stream,
    Work,
)
from meshdeform.client.requests import Endpoint

__all__ = ["AsyncDriver", "SyncDriver"]

T = TypeVar("T")


class SyncDriver:
    """Executes operations in the calling thread; threads may share it.

    Parameters
    ----------
    http : httpx.Client
    endpoint : Endpoint
    """

    def __init__(self, http: httpx.Client, endpoint: Endpoint) -> None:
        self._http, self._endpoint = http, endpoint

    def run(self, operation: Operation[T]) -> T:
        """Execute an operation and return its result."""
        steps = self.iterate(operation)
        while True:
            try:
                next(steps)
            except StopIteration as end:
                result: T = end.value
                return result

    def iterate(self, operation: Operation[T]) -> Generator[Any, None, T]:
        """Execute an operation, yield the items that it emits, and return its result."""
        with _Transport(self._http, self._endpoint) as transport:
            try:
                value, error = None, None
                while True:
                    try:
                        command: Command = operation.send(value) if error is None else operation.throw(error)
                    except StopIteration as end:
                        result: T = end.value
                        return result
                    value, error = None, None
                    if isinstance(command, Emit):
                        yield command.item
                        continue
                    try:
                        value = self._perform(command, transport)
                    except BaseException as raised:
                        error = raised
            finally:
                operation.close()

    def _perform(self, command: Command, transport: _Transport) -> Any:
        match command:
            case Send(call):
                return transport.send(call)
            case Stream(call):
                return transport.open(call)
            case Read():
                return transport.read()
            case Pause(seconds):
                return time.sleep(seconds)
            case Work(function):
                return function()
            case Callback(function, argument):
                return function(argument)
            case Shield(operation, _):
                return self.run(operation)
            case _:
                raise TypeError(f"no such command: {command!r}")


class _Transport:
    """Sends the requests of one operation and holds its open stream."""

    def __init__(self, http: httpx.Client, endpoint: Endpoint) -> None:
        self._http, self._endpoint = http, endpoint
        self._response: httpx.Response | None = None
        self._parts: Iterator[bytes] = iter(())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def _close(self) -> None:
        response, self._response = self._response, None
        if response is not None:
            response.close()

    def send(self, call: Call) -> Answer:
        request = self._endpoint.request(self._http, call)
        response = self._http.send(request, auth=_auth(call), follow_redirects=False)
        return self._endpoint.answer(response, response.content)

    def open(self, call: Call) -> Answer:
        self._close()
        response = self._http.send(self._endpoint.request(self._http, call), stream=True, follow_redirects=False)
        self._response = response
        content = b"" if response.is_success else response.read()
        self._parts = iter(()) if content else response.iter_raw()
        return self._endpoint.answer(response, content)

    def read(self) -> bytes:
        return next(self._parts, b"")


class AsyncDriver:
    """Executes operations in the calling task; tasks may share it.

    Parameters
    ----------
    http : httpx.AsyncClient
    endpoint : Endpoint
    """

    def __init__(self, http: httpx.AsyncClient, endpoint: Endpoint) -> None:
        self._http, self._endpoint = http, endpoint

    async def run(self, operation: Operation[T]) -> T:
        """Execute an operation and return its result."""
        result: list[T] = []
        async for _ in self.iterate(operation, result):
            pass
        return result[0]

    async def iterate(self, operation: Operation[T], result: list[T] | None = None) -> AsyncGenerator[Any, None]:
        """Execute an operation and yield the items that it emits; its result is appended to the list."""
        transport = _AsyncTransport(self._http, self._endpoint)
        try:
            value: Any = None
            error: BaseException | None = None
            while True:
                try:
                    command: Command = operation.send(value) if error is None else operation.throw(error)
                except StopIteration as end:
                    if result is not None:
                        result.append(end.value)
                    return
                value, error = None, None
                if isinstance(command, Emit):
                    yield command.item
                    continue
                try:
                    value = await self._perform(command, transport)
                except BaseException as raised:
                    error = raised
        finally:
            operation.close()
            with anyio.CancelScope(shield=True):
                await transport.close()

    async def _perform(self, command: Command, transport: _AsyncTransport) -> Any:
        match command:
            case Send(call):
                return await transport.send(call)
            case Stream(call):
                return await transport.open(call)
            case Read():
                return await transport.read()
            case Pause(seconds):
                return await anyio.sleep(seconds)
            case Work(function):
                return await anyio.to_thread.run_sync(function)
            case Callback(function, argument):
                returned = function(argument)
                return await returned if inspect.isawaitable(returned) else returned
            case Shield(operation, seconds):
                with anyio.move_on_after(seconds, shield=True):
                    return await self.run(operation)
                return None
            case _:
                raise TypeError(f"no such command: {command!r}")


class _AsyncTransport:
    """Sends the requests of one operation and holds its open stream."""

    def __init__(self, http: httpx.AsyncClient, endpoint: Endpoint) -> None:
        self._http, self._endpoint = http, endpoint
        self._response: httpx.Response | None = None
        self._parts: AsyncIterator[bytes] | None = None

    async def close(self) -> None:
        response, self._response, self._parts = self._response, None, None
        if response is not None:
            await response.aclose()

    async def send(self, call: Call) -> Answer:
        request = self._endpoint.request(self._http, call)
        response = await self._http.send(request, auth=_auth(call), follow_redirects=False)
        return self._endpoint.answer(response, response.content)

    async def open(self, call: Call) -> Answer:
        await self.close()
        request = self._endpoint.request(self._http, call)
        response = await self._http.send(request, stream=True, follow_redirects=False)
        self._response = response
        content = b"" if response.is_success else await response.aread()
        self._parts = None if content else response.aiter_raw()
        return self._endpoint.answer(response, content)

    async def read(self) -> bytes:
        return b"" if self._parts is None else await anext(self._parts, b"")


def _auth(call: Call) -> Any:
    """Return the httpx client's authentication, or none for a signed URL."""
    return httpx.Auth() if call.signed else httpx.USE_CLIENT_DEFAULT
