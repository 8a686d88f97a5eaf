"""Restrict the addresses of webhooks, and of files to fetch, to hosts that not only this server can reach (SSRF).

A host is resolved and all its addresses are checked and returned. The sender connects to these addresses without
resolving again, so that a DNS answer that changes in between has no effect.

Source: the IANA special-purpose address registries (RFC 6890 and its successors), for addresses that are not public.
"""

from __future__ import annotations

import ipaddress
import queue
import re
import socket
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from meshdeform.errors import DependencyError, LimitError, WebhookAddressError

if TYPE_CHECKING:
    import httpx

MAX_URL = 2000
"""Maximum number of characters in a webhook's URL."""

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
LOOKUP_S = 5.0
"""Seconds to wait for the addresses of a host."""
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Destination:
    """The destination of a message: a URL and its host's checked addresses, in the order to try them."""

    url: httpx.URL
    host: str
    port: int
    addresses: tuple[str, ...]


def parse_networks(blocks: Sequence[str]) -> Networks:
    """Return the networks listed in MESHDEFORM_WEBHOOK_NETWORKS; `DependencyError`: one is not a CIDR block."""
    try:
        return tuple(ipaddress.ip_network(block) for block in blocks)
    except ValueError as error:
        raise DependencyError(
            f"MESHDEFORM_WEBHOOK_NETWORKS is not a list of networks: {error}.",
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


def find_destination(url: str, networks: Networks, lookup: Lookup = system_lookup) -> Destination:
    """Parse a webhook's URL, resolve its host, and check all its addresses.

    `url`: `https`, without credentials, at port 80, 443 or one above 1023. `networks`: networks allowed besides the
    public internet; there `http` is allowed too; `lookup`: resolves the host.
    """
    read, host, port = _read(url)
    # One message for all cases, without the address: users must not learn which names exist in the server's network.
    refusal = WebhookAddressError(f"The host {host} is unknown, or has an address that is not public.")
    try:
        addresses = [ipaddress.ip_address(text) for text in lookup(host, port)]
    except (OSError, ValueError):  # a name that cannot be encoded is a ValueError
        raise refusal from None
    inside = [any(address in network for network in networks) for address in addresses]
    if not addresses or not all(known or is_public(address) for address, known in zip(addresses, inside, strict=True)):
        raise refusal
    if read.scheme != "https" and not all(inside):
        raise WebhookAddressError("The URL does not begin with https://.")
    return Destination(read, host, port, tuple(map(str, addresses)))


def _read(url: str) -> tuple[httpx.URL, str, int]:
    import httpx

    if len(url) > MAX_URL or re.search(r"[\s\\\x00-\x1f\x7f]", url):
        raise WebhookAddressError(f"The URL has more than {MAX_URL} characters, or characters not allowed in a URL.")
    try:
        read = httpx.URL(url)
        # Names in other scripts become their ASCII form here. Trailing dots are removed, as certificates omit them.
        host = read.raw_host.decode("ascii").lower().removesuffix(".")
    except (httpx.InvalidURL, ValueError) as error:
        raise WebhookAddressError("This is not a URL.") from error
    if read.scheme not in ("https", "http"):
        raise WebhookAddressError("The URL does not begin with https://.")
    if read.userinfo:
        raise WebhookAddressError("The URL has a user name or a password.", advice="Verify the signature instead.")
    _check_host(host)
    port = read.port if read.port is not None else 443 if read.scheme == "https" else 80
    if port not in (80, 443) and not 1024 <= port <= 65535:
        raise WebhookAddressError(f"Port {port} is not allowed.", advice="Use 443, 80 or one above 1023.")
    return read.copy_with(host=host, fragment=None), host, port


def _check_host(host: str) -> None:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        if not _NAME.match(host) or _NUMBER.search(host):
            raise WebhookAddressError("The URL's host is neither a name nor an IP address in the usual form.") from None
    if "%" in host:
        raise WebhookAddressError("The URL's host names a network interface.")


class LookupPool:
    """A fixed number of daemon threads. Unlike those of an executor, they do not keep the process from exiting.

    One owner may have `share` calls waiting or running; without it, any number.
    """

    def __init__(self, threads: int, share: int | None = None) -> None:
        self._most, self._share = threads, share
        self._calls: queue.SimpleQueue[tuple[Future[Any], Callable[[], Any]]] = queue.SimpleQueue()
        self._busy: Counter[str] = Counter()
        self._threads = 0
        self._lock = threading.Lock()

    def submit(self, owner: str, call: Callable[[], _Result]) -> Future[_Result]:
        """Start a call as soon as a thread is free. A cancelled future that has not started never runs.

        `LimitError`: the owner has too many unfinished calls.
        """
        future: Future[_Result] = Future()
        with self._lock:
            if self._share is not None and self._busy[owner] >= self._share:
                raise LimitError(
                    f"{self._share} host names are already being resolved for this API key.",
                    advice="Try again in a moment.",
                )
            self._busy[owner] += 1
            if self._threads < min(self._most, self._busy.total()):
                self._threads += 1
                threading.Thread(target=self._run, name="lookup", daemon=True).start()
        future.add_done_callback(lambda _: self._release(owner))
        self._calls.put((future, call))
        return future

    def lookup(self, host: str, port: int) -> list[str]:
        """Resolve a host and return its addresses. A `Lookup` with a deadline.

        `OSError`: the host has no address, or its addresses did not arrive in time.
        """
        future = self.submit("", lambda: system_lookup(host, port))
        try:
            return list(future.result(LOOKUP_S))
        finally:
            future.cancel()

    def _release(self, owner: str) -> None:
        with self._lock:
            self._busy[owner] -= 1
            if not self._busy[owner]:
                del self._busy[owner]

    def _run(self) -> None:
        while True:
            future, call = self._calls.get()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(call())
            except BaseException as error:
                future.set_exception(error)
