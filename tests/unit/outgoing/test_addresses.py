"""Where the server may go: every range that is not public, every way to write one, and what an operator allows."""

from __future__ import annotations

import ipaddress

import pytest

from meshdeform.errors import DependencyError, WebhookAddressError
from meshdeform.outgoing.addresses import MAX_URL, find_destination, is_public, parse_networks
from tests.cases import each_case

# Both ends of every block, and one address past it where that one is public.
NOT_PUBLIC = [
    "0.0.0.0", "0.255.255.255", "10.0.0.0", "10.255.255.255", "100.64.0.0", "100.127.255.255", "127.0.0.0",
    "127.0.0.1", "127.255.255.255", "168.63.129.16", "169.254.0.0", "169.254.169.254", "169.254.255.255", "172.16.0.0",
    "172.31.255.255", "192.0.0.0", "192.0.0.170", "192.0.0.255", "192.0.2.1", "192.88.99.1", "192.168.0.0",
    "192.168.255.255", "198.18.0.0", "198.19.255.255", "198.51.100.7", "203.0.113.7", "224.0.0.1", "239.255.255.255",
    "240.0.0.1", "255.255.255.255",
    "::", "::1", "::127.0.0.1", "::ffff:127.0.0.1", "::ffff:10.0.0.1", "::ffff:8.8.8.8", "64:ff9b::127.0.0.1",
    "64:ff9b::169.254.169.254", "64:ff9b:1::8.8.8.8", "100::1", "2001::1", "2001:0:4136:e378:8000:63bf:3fff:fdd2",
    "2001:db8::1", "2001:1ff:ffff::1", "2002:7f00:1::1", "2002:808:808::1", "3fff::1", "4000::1", "5f00::1",
    "fc00::1", "fd00:ec2::254", "fdff:ffff::1", "fe80::1", "febf::1", "fec0::1", "ff02::1", "ff0e::1",
]  # fmt: skip
PUBLIC = [
    "1.0.0.0", "8.8.8.8", "9.255.255.255", "11.0.0.0", "100.63.255.255", "100.128.0.0", "126.255.255.255", "128.0.0.0",
    "169.253.255.255", "169.255.0.0", "172.15.255.255", "172.32.0.0", "192.0.1.0", "192.167.255.255", "192.169.0.0",
    "198.17.255.255", "198.20.0.0", "223.255.255.255", "2001:200::1", "2606:4700::1111", "2a00:1450::1",
    "64:ff9b::8.8.8.8",
]  # fmt: skip
SETTING = "MESHDEFORM_FETCH_NETWORKS"
LOOPBACK = parse_networks(["127.0.0.0/8", "::1/128"], SETTING)


def knows(*addresses: str):
    return lambda host, port: addresses


@each_case("address", NOT_PUBLIC)
def test_an_address_that_is_not_public_is_refused_by_itself_and_as_what_a_name_means(address: str) -> None:
    assert not is_public(ipaddress.ip_address(address))
    literal = f"[{address}]" if ":" in address else address
    with pytest.raises(WebhookAddressError, match="not public"):
        find_destination("https://example.com/", (), WebhookAddressError, knows("8.8.8.8", address))
    with pytest.raises(WebhookAddressError, match="not public"):
        find_destination(f"https://{literal}/", (), WebhookAddressError)


@each_case("address", PUBLIC)
def test_a_public_address_is_taken(address: str) -> None:
    found = find_destination("https://example.com/hook", (), WebhookAddressError, knows(address))
    assert (found.host, found.port) == ("example.com", 443)
    assert [ipaddress.ip_address(text) for text in found.addresses] == [ipaddress.ip_address(address)]


@each_case(
    "host",
    ["2130706433", "0x7f000001", "0x7f.1", "0177.0.0.1", "017700000001", "127.1", "127.0.1", "0x7f.0x0.0x0.0x1", "0",
     "127.0.0.1.1", "1.2.3.256", "example.0x7f"],
)  # fmt: skip
def test_numbers_that_resolvers_take_for_addresses_are_no_hosts(host: str) -> None:
    def forbidden(host: str, port: int) -> list[str]:
        raise AssertionError("it was looked up")

    for written in (host, f"{host}."):
        with pytest.raises(WebhookAddressError):
            find_destination(f"https://{written}/", LOOPBACK, WebhookAddressError, forbidden)
    for written in ("LOCALHOST", "localhost.", "127.0.0.1.", "[::ffff:7f00:1]"):
        with pytest.raises(WebhookAddressError):
            find_destination(f"https://{written}/", (), WebhookAddressError)


@each_case(
    ("url", "says"),
    [
        ("http://example.com/", "https"),
        ("ftp://example.com/", "https"),
        ("example.com/hook", "https"),
        ("//example.com/hook", "https"),
        ("https:///hook", "host"),
        ("https://user@example.com/", "password"),
        ("https://example.com:22/", "Port 22"),
        ("https://example.com:0/", "Port 0"),
        ("https://example.com:1023/", "Port 1023"),
        ("https://example.com:65536/", "."),
        ("https://example.com:port/", "URL"),
        ("https://exa mple.com/", "characters"),
        ("https://example.com\\@10.0.0.1/", "characters"),
        ("https://example.com/\r\nX-Evil: 1", "characters"),
        ("https://exam%70le.com/", "host"),
        ("https://\uff11\uff12\uff17.0.0.1/", "."),
        ("https://[::1", "."),
        ("https://[fe80::1%25eth0]/", "."),
        ("https://-example.com/", "host"),
        ("https://example..com/", "host"),
        ("https://" + "a" * 64 + ".com:1/", "Port 1"),
        ("https://example.com/" + "a" * MAX_URL, "characters"),
    ],
)
def test_what_is_no_address_of_a_webhook(url: str, says: str) -> None:
    with pytest.raises(WebhookAddressError) as refused:
        find_destination(url, (), WebhookAddressError, knows("8.8.8.8"))
    assert says in refused.value.detail


def test_a_name_in_another_script_is_looked_up_in_its_ascii_form() -> None:
    asked = []

    def lookup(host: str, port: int) -> list[str]:
        asked.append((host, port))
        return ["8.8.8.8"]

    found = find_destination("https://Bücher.example.:8443/ä?q=ü#part", (), WebhookAddressError, lookup)
    assert asked == [("xn--bcher-kva.example", 8443)]
    assert (found.url.netloc, found.url.raw_path) == (b"xn--bcher-kva.example:8443", b"/%C3%A4?q=%C3%BC")


@each_case("error", [OSError("no"), UnicodeError("label too long"), ValueError("no address")])
def test_hosts_that_are_unknown_or_inside_are_refused_alike(error: Exception) -> None:
    def lookup(host: str, port: int) -> list[str]:
        raise error

    details = set()
    for found in (lookup, knows(), knows("10.20.30.40"), knows("8.8.8.8", "::1")):
        with pytest.raises(WebhookAddressError) as refused:
            find_destination("https://intranet.example/", (), WebhookAddressError, found)
        details.add(refused.value.detail)
    assert len(details) == 1, "the refusals tell which names exist"
    assert "10.20" not in details.pop()


def test_allowed_networks_may_be_called_and_there_without_tls() -> None:
    networks = parse_networks(["10.1.0.0/16", "fd00::/8"], SETTING)
    assert (
        find_destination(
            "http://inside.example:8080/", networks, WebhookAddressError, knows("10.1.2.3", "fd00::1")
        ).port
        == 8080
    )
    assert (
        find_destination("https://inside.example/", networks, WebhookAddressError, knows("10.1.2.3", "8.8.8.8")).port
        == 443
    )
    for addresses in (["10.2.0.1"], ["10.1.2.3", "10.2.0.1"], ["::ffff:10.1.2.3"]):
        with pytest.raises(WebhookAddressError, match="not public"):
            find_destination("https://inside.example/", networks, WebhookAddressError, knows(*addresses))
    with pytest.raises(WebhookAddressError, match="https"):
        find_destination("http://inside.example/", networks, WebhookAddressError, knows("10.1.2.3", "8.8.8.8"))


@each_case("block", ["10.0.0.1/8", "localhost", "10.0.0.0/33", ""])
def test_what_is_no_network_is_said_at_the_start(block: str) -> None:
    with pytest.raises(DependencyError, match=SETTING):
        parse_networks([block], SETTING)
