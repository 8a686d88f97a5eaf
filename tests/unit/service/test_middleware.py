"""The frame around a request, without a server: ids, headers, body limits, and the line in the log."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

import pytest

from meshdeform.api.limits import MAX_DOCUMENT_BYTES
from meshdeform.errors import AssetTooLargeError
from meshdeform.support.telemetry import ACCESS_LOG
from service.http.middleware import RequestFrame, request_id
from tests.cases import each_case


class Route:
    """What the router leaves behind."""

    def __init__(self, path: str, body_field: object = None) -> None:
        self.path, self.body_field = path, body_field


def run(app: Any, headers: dict[str, str] | None = None, parts: tuple[bytes, ...] = (b"",)) -> list[dict[str, Any]]:
    """Send one request through the frame and return the messages of the answer."""
    sent: list[dict[str, Any]] = []
    body = [
        {"type": "http.request", "body": part, "more_body": number + 1 < len(parts)}
        for number, part in enumerate(parts)
    ]
    scope = {
        "type": "http",
        "http_version": "1.0",  # which needs no Host header
        "method": "GET",
        "path": "/v1/things/7",
        "query_string": b"signature=secret",
        "headers": [(name.lower().encode(), value.encode("latin-1")) for name, value in (headers or {}).items()],
    }

    async def receive() -> dict[str, Any]:
        return body.pop(0)

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    asyncio.run(RequestFrame(app)(scope, receive, send))
    return sent


async def answer(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": [(b"x-seen", request_id().encode())]})
    await send({"type": "http.response.body", "body": b"a", "more_body": True})
    await send({"type": "http.response.body", "body": b"b"})


def headers_of(messages: list[dict[str, Any]]) -> dict[str, str]:
    return {name.decode().lower(): value.decode() for name, value in messages[0]["headers"]}


@each_case(
    ("sent", "kept"),
    [(each, True) for each in ("abc", "0af7651916cd43dd8448eb211c80319c", "~" * 128, "a{};:/=?b")]
    + [(each, False) for each in ("", "~" * 129, "two words", "ä", "tab\there", "x\x7f")],
)
def test_an_id_that_is_sent_is_kept_unless_it_cannot_stand_in_a_log(sent: str, kept: bool) -> None:
    answers = [run(answer, {"X-Request-ID": sent}) for _ in range(2)]
    first, second = (headers_of(each)["x-request-id"] for each in answers)
    assert headers_of(answers[0])["x-seen"] == first
    assert (first == second == sent) if kept else (first.startswith("req_") and first != second)
    assert [message.get("body") for message in answers[0]] == [None, b"a", b"b"]


def test_every_answer_is_data_and_no_page_unless_it_says_so() -> None:
    found = headers_of(run(answer))
    assert found["x-content-type-options"] == "nosniff"
    assert found["referrer-policy"] == "no-referrer"
    assert found["content-security-policy"].startswith("default-src 'none'")

    async def page(scope: Any, receive: Any, send: Any) -> None:
        headers = [(b"content-security-policy", b"default-src 'self'")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})

    assert headers_of(run(page))["content-security-policy"] == "default-src 'self'"


def reader(route: Route) -> Any:
    async def app(scope: Any, receive: Any, send: Any) -> None:
        scope["route"] = route
        while (await receive())["more_body"]:
            pass
        await answer(scope, receive, send)

    return app


HALF = b"x" * (MAX_DOCUMENT_BYTES // 2)


def test_a_body_that_is_parsed_has_a_limit_that_holds_while_it_comes() -> None:
    """A route that reads its own body keeps its own limit."""
    route = Route("/v1/webhooks", body_field=object())
    assert run(reader(route), parts=(HALF, HALF))[0]["status"] == 200
    with pytest.raises(AssetTooLargeError, match="larger than 262,144 bytes"):
        run(reader(route), parts=(HALF, HALF, b"x", b"never read"))
    assert run(reader(Route("/v1/jobs")), parts=(HALF, HALF, HALF))[0]["status"] == 200


def test_the_access_log_has_the_route_and_no_query(caplog: pytest.LogCaptureFixture) -> None:
    async def app(scope: Any, receive: Any, send: Any) -> None:
        scope["route"] = Route("/v1/things/{id}")
        await answer(scope, receive, send)

    with caplog.at_level(logging.INFO, ACCESS_LOG):
        run(app)
    (record,) = caplog.records
    assert record.getMessage().startswith("GET /v1/things/{id} 200 ")
    assert (record.method, record.route, record.status) == ("GET", "/v1/things/{id}", 200)  # type: ignore[attr-defined]
    assert record.duration_ms >= 0  # type: ignore[attr-defined]
    assert "secret" not in str(vars(record))


def test_a_failure_is_logged_as_500_and_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    async def app(scope: Any, receive: Any, send: Any) -> None:
        raise RuntimeError("broken")

    with caplog.at_level(logging.INFO, ACCESS_LOG), pytest.raises(RuntimeError, match="broken"):
        run(app)
    assert [record.status for record in caplog.records] == [500]  # type: ignore[attr-defined]
