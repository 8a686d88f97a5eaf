"""Who can reach an address, and whether requests at it need a key."""

from __future__ import annotations

from meshdeform.serving.access import is_loopback, needs_keys
from tests.cases import each_case


@each_case("address", ["127.0.0.1", "127.8.9.10", "::1", "::ffff:127.0.0.1", "localhost", "::1%lo"])
def test_loopback_needs_no_key(address: str) -> None:
    assert is_loopback(address)
    assert not needs_keys("auto", address)


@each_case(
    "address",
    [
        "0.0.0.0",
        "::",
        "192.0.2.7",
        "10.0.0.1",
        "::ffff:192.0.2.7",
        "fe80::1%eth0",
        "example.com",
        "",
        "127.0.0.1.nip.io",
    ]
    + ["/run/meshdeform.sock", "localhost.example.com", None],
)
def test_whatever_is_not_certainly_loopback_needs_one(address: str | None) -> None:
    assert not is_loopback(address)
    assert needs_keys("auto", address)


@each_case("address", ["127.0.0.1", "0.0.0.0", None])
def test_on_and_off_ask_no_address(address: str | None) -> None:
    assert needs_keys("on", address)
    assert not needs_keys("off", address)
