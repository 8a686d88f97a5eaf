"""Whether requests need an API key: one rule for the commands, which know where they listen, and for each request."""

from __future__ import annotations

import ipaddress
from typing import Literal
from urllib.parse import urlsplit

__all__ = ["is_foreign", "is_loopback", "needs_keys"]


def needs_keys(auth: Literal["auto", "on", "off"], address: str | None) -> bool:
    """Whether requests that come in at an address need a key.

    Parameters
    ----------
    auth : {"auto", "on", "off"}
        The setting.
    address : str or None
        Where the API listens, or the local end of a connection; never the peer's, which a proxy on this machine would
        make look harmless. None, or the path of a socket: nobody knows who is behind it.
    """
    if auth == "auto":
        return not is_loopback(address)
    return auth == "on"


def is_loopback(address: str | None) -> bool:
    """Whether only this machine can reach an address. A name other than `localhost` is not looked up: it is not."""
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


def is_foreign(host: str | None, origin: str | None) -> bool:
    """Whether a request that reached loopback was sent by a web page that is not this machine's.

    A browser on this machine runs pages of others. Such a page may post forms to any address, which the header `Origin`
    tells; and its host's name may suddenly lead to loopback (DNS rebinding), which the header `Host` tells.

    Parameters
    ----------
    host, origin : str or None
        The headers of the request.
    """
    if origin is not None and not is_loopback(_name(origin)):
        return True
    return host is not None and not is_loopback(_name(f"//{host}"))


def _name(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
