"""Web pages of others cannot use a service on loopback through the browser of whoever runs it."""

from __future__ import annotations

from meshdeform.serving.access import is_foreign
from tests.cases import each_case


@each_case(
    ("host", "origin"),
    [
        ("127.0.0.1:8765", None),
        ("localhost:8765", None),
        ("[::1]:8765", None),
        (None, None),
        ("localhost:8765", "http://localhost:8765"),
        ("127.0.0.1:8765", "http://localhost:3000"),
    ],
)
def test_programs_and_pages_of_this_machine_may_ask(host: str | None, origin: str | None) -> None:
    assert not is_foreign(host, origin)


@each_case(
    ("host", "origin"),
    [
        ("evil.example:8765", None),
        ("evil.example", "http://evil.example"),
        ("127.0.0.1:8765", "https://evil.example"),
        ("127.0.0.1:8765", "null"),
        ("127.0.0.1.evil.example", None),
        ("localhost.evil.example", None),
        ("[::1", None),
        ("", None),
        ("10.0.0.7:8765", None),
    ],
)
def test_pages_of_others_may_not(host: str | None, origin: str | None) -> None:
    assert is_foreign(host, origin)
