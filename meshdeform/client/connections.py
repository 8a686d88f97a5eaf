"""Provide what a client has before it does anything: the service's address, the key, and its connections."""

from __future__ import annotations

from types import TracebackType
from typing import Self

import httpx

from meshdeform.client.drivers import AsyncDriver, SyncDriver
from meshdeform.client.requests import Endpoint
from meshdeform.client.retries import Policy

__all__ = ["AsyncConnection", "Connection"]


def _address(base_url: str | None, http: httpx.Client | httpx.AsyncClient | None) -> str | None:
    """Return the address that is stated, or else that of the HTTP client, if it has one."""
    if base_url is None and http is not None:
        return str(http.base_url) or None
    return base_url


class _Service:
    """The service that a client speaks to. Parameters and errors are those of `Client`."""

    def __init__(self, base_url: str | None, api_key: str | None, timeout_s: float, max_retries: int) -> None:
        self._endpoint = Endpoint.of(base_url, api_key, timeout_s)
        self._policy = Policy.of(timeout_s, max_retries)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._endpoint.base_url!r})"

    @property
    def base_url(self) -> str:
        """The service's address."""
        return self._endpoint.base_url


class Connection(_Service):
    """Connections to a service for threads. Parameters and errors are those of `Client`."""

    def __init__(
        self,
        base_url: str | None = None,
        *,
        api_key: str | None = None,
        timeout_s: float = 60.0,
        max_retries: int = 4,
        http: httpx.Client | None = None,
    ) -> None:
        super().__init__(_address(base_url, http), api_key, timeout_s, max_retries)
        self._owned = http is None
        # No limit on connections: each thread that follows events keeps one open.
        self._http = http or httpx.Client(limits=httpx.Limits(max_connections=None))
        self._driver = SyncDriver(self._http, self._endpoint)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        if self._owned:
            self._http.close()


class AsyncConnection(_Service):
    """Connections to a service for event loops. Parameters and errors are those of `AsyncClient`."""

    def __init__(
        self,
        base_url: str | None = None,
        *,
        api_key: str | None = None,
        timeout_s: float = 60.0,
        max_retries: int = 4,
        http: httpx.AsyncClient | None = None,
    ) -> None:
        super().__init__(_address(base_url, http), api_key, timeout_s, max_retries)
        self._owned = http is None
        # No limit on connections: each task that follows events keeps one open.
        self._http = http or httpx.AsyncClient(limits=httpx.Limits(max_connections=None))
        self._driver = AsyncDriver(self._http, self._endpoint)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close the connections."""
        if self._owned:
            await self._http.aclose()
