"""Decide whether requests need an API key, with one rule for the commands that listen and for each request."""

from __future__ import annotations

import ipaddress
from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, Literal
from urllib.parse import urlsplit

from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.settings import Settings

ANY = "*"
"""What stands for pages of every origin."""


_FORWARDING = frozenset(
    ("cf-connecting-ip", "client-ip", "fly-client-ip", "forwarded", "true-client-ip", "via", "x-client-ip")
    + ("x-cluster-client-ip", "x-original-forwarded-for", "x-original-host", "x-real-ip")
)


def needs_keys(auth: Literal["auto", "on", "off"], address: str | None) -> bool:
    """Return whether requests that arrive at an address need a key.

    The address is where the API listens, or the local end of a connection. Never the peer's address, which behind a
    proxy on this machine is always local. None, or the path of a socket: the clients are unknown, so that keys are
    needed.
    """
    if auth == "auto":
        return not is_loopback(address)
    return auth == "on"


def is_loopback(address: str | None) -> bool:
    """Return whether only this machine can reach an address. Names other than `localhost` count as reachable."""
    if address is None:
        return False
    if address == "localhost":
        return True
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(parsed, "ipv4_mapped", None)
    return bool((mapped or parsed).is_loopback)


def check_origins(settings: Settings) -> None:
    """Raise ParameterError if every web page could use the API of a service with keys."""
    if ANY in settings.cors_origins and settings.auth != "off":
        raise ParameterError(
            "MESHDEFORM_CORS_ORIGINS is *, and requests need keys.",
            advice="List the origins of your pages, such as https://app.example. For every page in the world, keys "
            "have to be off: MESHDEFORM_AUTH=off.",
        )


def is_forwarded(headers: Iterable[str]) -> bool:
    """Return whether a request with headers of these names came through a proxy, so that its client may be anywhere."""
    return any(name.lower() in _FORWARDING or name.lower().startswith("x-forwarded") for name in headers)


def is_foreign(
    host: str | None, origin: str | None, allowed_hosts: Collection[str] = (), allowed_origins: Collection[str] = ()
) -> bool:
    """Return whether a request to loopback was sent by a web page from a host that is not allowed besides loopback.

    A browser on this machine also runs pages from other hosts. Such a page can post forms to any address, which the
    header `Origin` reveals, and its host name can change to loopback (DNS rebinding), which the header `Host` reveals.
    """
    if origin in allowed_origins or ANY in allowed_origins:
        origin = None
    urls = [origin, None if host is None else f"//{host}"]
    names = [_name(url) for url in urls if url is not None]
    return any(not is_loopback(name) and name not in allowed_hosts for name in names)


def _name(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
