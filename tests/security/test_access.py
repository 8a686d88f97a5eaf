"""Who may use a service without a key, and what guesses of keys can do to others."""

from __future__ import annotations

import socket

import httpx
import pytest

from meshdeform.record.repository import JobRecord
from meshdeform.serving.access import is_forwarded
from service.http.auth import _FAILURES
from tests.integration.conftest import DEADLINE_S, Start

EVIL = ({"Origin": "https://evil.example"}, {"Host": "evil.example"}, {"Host": "evil.example:80", "Origin": "null"})
FORWARDING = ("X-Forwarded-For", "X-Forwarded-Host", "X-Forwarded-Proto", "Forwarded", "X-Real-IP", "Via")


def status(http: httpx.Client, **headers: str) -> int:
    return http.get("/v1/jobs", headers={name.replace("_", "-"): value for name, value in headers.items()}).status_code


@pytest.mark.parametrize("auth", ["auto", "off"])
def test_web_pages_of_other_hosts_are_refused_on_loopback_with_and_without_no_auth(start: Start, auth: str) -> None:
    http = start(auth=auth, allowed_hosts=["meshes.example"])
    for headers in EVIL:
        assert http.get("/v1/jobs", headers=headers).status_code == 401, headers
        files = {"asset": b"", "request": b"{}"}
        assert http.post("/v1/jobs", headers=headers, files=files).status_code == 401, headers
    assert status(http, Origin="http://localhost:1234") == 200
    assert status(http, Origin="https://meshes.example", Host="meshes.example") == 200


def test_a_request_with_two_hosts_is_refused(start: Start) -> None:
    address = start().base_url
    with socket.create_connection((address.host, address.port), DEADLINE_S) as connection:
        connection.sendall(b"GET /v1/jobs HTTP/1.1\r\nHost: a\r\nHost: b\r\nConnection: close\r\n\r\n")
        answer = b"".join(iter(lambda: connection.recv(4096), b""))
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert b"several Host headers" in answer


def test_auto_needs_a_key_where_a_proxy_is_in_front(start: Start, record: JobRecord) -> None:
    http = start()
    _, text = record.keys.create("studio")
    assert status(http) == 200
    for name in FORWARDING:
        assert is_forwarded([name])
        assert http.get("/v1/jobs", headers={name: "203.0.113.7"}).status_code == 401, name
    assert status(http, X_Forwarded_For="203.0.113.7", Authorization=f"Bearer {text}") == 200
    assert status(start(auth="off"), X_Forwarded_For="203.0.113.7") == 200


def guess(http: httpx.Client, number: int) -> int:
    return status(http, Authorization=f"Bearer guess-{number}", X_Forwarded_For=f"203.0.113.{number}")


def test_a_forwarded_address_counts_only_if_a_trusted_proxy_sends_it(start: Start) -> None:
    many = range(_FAILURES.burst + 1)
    doubting = start(auth="on")
    assert [guess(doubting, number) for number in many] == [401] * _FAILURES.burst + [429]
    trusting = start(auth="on", trusted_proxies=["127.0.0.0/8"])
    assert {guess(trusting, number) for number in many} == {401}


def test_a_guesser_does_not_lock_out_a_valid_key_at_the_same_address(start: Start, record: JobRecord) -> None:
    http = start(auth="on")
    _, text = record.keys.create("studio")
    while guess(http, 1) != 429:
        pass
    assert status(http, Authorization=f"Bearer {text}") == 200
    assert guess(http, 2) == 429
