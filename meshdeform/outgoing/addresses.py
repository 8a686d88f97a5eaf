"""Restrict what the server connects to for its users to hosts that not only this server can reach (SSRF).

A host is resolved and all its addresses are checked and returned. `network` connects to these addresses without
resolving again, so that a DNS answer that changes in between has no effect.

Source: the IANA special-purpose address registries (RFC 6890 and its successors), for addresses that are not public.
"""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from meshdeform.errors import DependencyError, MeshdeformError

if TYPE_CHECKING:
    import httpx

MAX_URL = 2000
"""Maximum number of characters in a URL."""

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Networks = tuple[ipaddress.IPv4Network | ipaddress.IPv6Network, ...]
Lookup = Callable[[str, int], Sequence[str]]
"""Returns the addresses of a host; raises OSError if there are none."""

# Python 3.11's `is_global` misses some of these, and counts translated addresses as global.
_NOT_PUBLIC_4 = tuple(
    ipaddress.IPv4Network(block)
    for block in (
        "0.0.0.0/8",
        "10.0.0.0/8",
        "100.64.0.0/10",
        "127.0.0.0/8",
        "168.63.129.16/32",  # Azure's platform services; public, but reachable only from inside
        "169.254.0.0/16",
        "172.16.0.0/12",
        "192.0.0.0/24",
        "192.0.2.0/24",
        "192.88.99.0/24",
        "192.168.0.0/16",
        "198.18.0.0/15",
        "198.51.100.0/24",
        "203.0.113.0/24",
        "224.0.0.0/4",
        "240.0.0.0/4",
    )
)
# All assigned public IPv6 addresses are in 2000::/3. Loopback, mapped (::ffff:0:0/96), unique local, link-local and
# multicast addresses are outside it; these are inside: Teredo and its neighbours, documentation, 6to4.
_GLOBAL_UNICAST_6 = ipaddress.IPv6Network("2000::/3")
_NOT_PUBLIC_6 = tuple(
    ipaddress.IPv6Network(block) for block in ("2001::/23", "2001:db8::/32", "2002::/16", "3fff::/20")
)
# IPv4 addresses as an IPv6-only network represents them (RFC 6052): public if the IPv4 address is.
_TRANSLATED_6 = ipaddress.IPv6Network("64:ff9b::/96")

_NAME = re.compile(r"(?=.{1,253}\Z)[a-z0-9_]([a-z0-9_-]*[a-z0-9_])?(\.[a-z0-9_]([a-z0-9_-]*[a-z0-9_])?)*\Z")
# Forms that resolvers read as IPv4 addresses besides four decimals: 2130706433, 0x7f.1, 127.1, 0177.0.0.1.
_NUMBER = re.compile(r"(^|\.)([0-9]+|0x[0-9a-f]*)\Z")


@dataclass(frozen=True)
class Destination:
    """A URL and its host's checked addresses, in the order to try them."""

    url: httpx.URL
    host: str
    port: int
    addresses: tuple[str, ...]


def parse_networks(blocks: Sequence[str], setting: str) -> Networks:
    """Return the networks that a setting lists; `DependencyError`: one is not a CIDR block."""
    try:
        return tuple(ipaddress.ip_network(block) for block in blocks)
    except ValueError as error:
        raise DependencyError(
            f"{setting} is not a list of networks: {error}.",
            advice="Write CIDR blocks separated by commas, for example 10.1.0.0/16,fd00::/8.",
        ) from error


def is_public(address: Address) -> bool:
    """Return whether the address belongs to the public internet."""
    if isinstance(address, ipaddress.IPv4Address):
        return not any(address in block for block in _NOT_PUBLIC_4)
    if address in _TRANSLATED_6:
        return is_public(ipaddress.IPv4Address(int(address) & 0xFFFFFFFF))
    return address in _GLOBAL_UNICAST_6 and not any(address in block for block in _NOT_PUBLIC_6)


def system_lookup(host: str, port: int) -> list[str]:
    """Resolve a host with the system's resolver and return its addresses, the preferred one first."""
    answers = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return list(dict.fromkeys(str(entry[4][0]) for entry in answers))


def find_destination(
    url: str, networks: Networks, refusal: type[MeshdeformError], lookup: Lookup = system_lookup
) -> Destination:
    """Parse a URL, resolve its host, and check all its addresses.

    `url`: `https`, without credentials, at port 80, 443 or one above 1023. `networks`: networks allowed besides the
    public internet; there `http` is allowed too; `refusal`: the error of a URL that is not allowed; `lookup`: resolves
    the host.
    """
    read, host, port = _read(url, refusal)
    # One message for all cases, without the address: users must not learn which names exist in the server's network.
    refused = refusal(f"The host {host} is unknown, or has an address that is not public.")
    try:
        addresses = [ipaddress.ip_address(text) for text in lookup(host, port)]
    except (OSError, ValueError):  # a name that cannot be encoded is a ValueError
        raise refused from None
    inside = [any(address in network for network in networks) for address in addresses]
    if not addresses or not all(known or is_public(address) for address, known in zip(addresses, inside, strict=True)):
        raise refused
    if read.scheme != "https" and not all(inside):
        raise refusal("The URL does not begin with https://.")
    return Destination(read, host, port, tuple(map(str, addresses)))


def _read(url: str, refusal: type[MeshdeformError]) -> tuple[httpx.URL, str, int]:
    import httpx

    if len(url) > MAX_URL or re.search(r"[\s\\\x00-\x1f\x7f]", url):
        raise refusal(f"The URL has more than {MAX_URL} characters, or characters not allowed in a URL.")
    try:
        read = httpx.URL(url)
        # Names in other scripts become their ASCII form here. Trailing dots are removed, as certificates omit them.
        host = read.raw_host.decode("ascii").lower().removesuffix(".")
    except (httpx.InvalidURL, ValueError) as error:
        raise refusal("This is not a URL.") from error
    if read.scheme not in ("https", "http"):
        raise refusal("The URL does not begin with https://.")
    if read.userinfo:
        raise refusal("The URL has a user name or a password.", advice="Leave them out.")
    _check_host(host, refusal)
    port = read.port if read.port is not None else 443 if read.scheme == "https" else 80
    if port not in (80, 443) and not 1024 <= port <= 65535:
        raise refusal(f"Port {port} is not allowed.", advice="Use 443, 80 or one above 1023.")
    return read.copy_with(host=host, fragment=None), host, port


def _check_host(host: str, refusal: type[MeshdeformError]) -> None:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        if not _NAME.match(host) or _NUMBER.search(host):
            raise refusal("The URL's host is neither a name nor an IP address in the usual form.") from None
    if "%" in host:
        raise refusal("The URL's host names a network interface.")
