"""No route is open by mistake, and guesses are counted for whoever makes them."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi import Request

from service.app import create_app
from service.http.auth import _peer
from tests.cases import each_case

KEY = [{"apiKey": []}]
# What a URL permits that was signed for it, instead of a key or besides one; and what is open to everybody.
SIGNED = {("get", "/v1/jobs/{id}/artifacts/{name}"): [*KEY, {}], ("put", "/v1/uploads/{id}/content"): []}
OPEN = {("get", "/healthz"), ("get", "/readyz")}


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    return create_app().openapi()


def test_every_route_asks_who_it_is_but_those_that_are_named_here(document: dict[str, Any]) -> None:
    routes = {(method, path): said for path, methods in document["paths"].items() for method, said in methods.items()}
    assert routes.keys() >= SIGNED.keys() | OPEN
    for route, said in routes.items():
        if route in OPEN:
            assert not said.get("security"), route
        else:
            assert said.get("security") == SIGNED.get(route, KEY), f"{route} takes no PrincipalDep"
        if KEY[0] in said.get("security", []):
            assert {"401", "429"} <= said["responses"].keys(), route
    scheme = document["components"]["securitySchemes"]["apiKey"]
    assert (scheme["type"], scheme["scheme"]) == ("http", "bearer")


@each_case(
    ("host", "counted_for"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2::9%eth0", "2001:db8:1:2::/64"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("testclient", "testclient"),
    ],
)
def test_guesses_are_counted_for_a_sender_not_for_each_of_its_addresses(host: str, counted_for: str) -> None:
    assert _peer(Request({"type": "http", "client": (host, 1)})) == counted_for
