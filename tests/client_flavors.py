"""Both clients behind one interface, so that a test of the one is a test of the other.

The one is made of the other, word by word. So most tests run on `Client`
alone; what `both_clients` marks runs on each, because there an event loop can differ from a thread.
"""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Callable, Iterator
from typing import Any, cast

import pytest
from anyio.from_thread import BlockingPortal, start_blocking_portal

from meshdeform.client import AsyncClient, AsyncResult, Client

__all__ = ["FLAVORS", "both_clients", "opened"]

FLAVORS = ("sync", "async")
both_clients = pytest.mark.parametrize("client", FLAVORS, indirect=True)


class _Blocking:
    """An `AsyncClient` (or its result) whose methods wait, in an event loop of another thread."""

    def __init__(self, inner: Any, portal: BlockingPortal) -> None:
        self._inner, self._portal = inner, portal

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._inner, name)
        return self._waiting(found) if callable(found) else found

    def _waiting(self, method: Callable[..., Any]) -> Callable[..., Any]:
        async def call(*arguments: Any, **options: Any) -> Any:
            came = method(*arguments, **options)
            return await came if inspect.isawaitable(came) else came

        def wait(*arguments: Any, **options: Any) -> Any:
            came = self._portal.call(lambda: call(*arguments, **options))
            if isinstance(came, AsyncResult):
                return _Blocking(came, self._portal)
            return self._items(came) if inspect.isasyncgen(came) else came

        return wait

    def _items(self, items: Any) -> Iterator[Any]:
        try:
            while True:
                try:
                    yield self._portal.call(anext, items)
                except StopAsyncIteration:
                    return
        finally:
            self._portal.call(items.aclose)


@contextlib.contextmanager
def opened(flavor: str, *arguments: Any, **options: Any) -> Iterator[Client]:
    """A client of a flavor; what it has is that of `Client`."""
    if flavor == "sync":
        with Client(*arguments, **options) as client:
            yield client
        return
    with start_blocking_portal() as portal:
        inner = AsyncClient(*arguments, **options)
        try:
            yield cast("Client", _Blocking(inner, portal))
        finally:
            portal.call(inner.aclose)
