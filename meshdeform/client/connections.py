"""Provide what a client has before it does anything: the service's address, the key, and when it tries again."""

from __future__ import annotations

import httpx

from meshdeform.client.requests import Endpoint
from meshdeform.client.retries import Policy

__all__ = ["Service", "address"]


def address(base_url: str | None, http: httpx.Client | httpx.AsyncClient | None) -> str | None:
    """Return the address that is stated, or else that of the HTTP client, if it has one."""
    if base_url is None and http is not None:
        return str(http.base_url) or None
    return base_url


class Service:
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
