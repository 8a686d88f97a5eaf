"""Which requests are sent again, how often, and after which pauses."""

from __future__ import annotations

import json
import time
from typing import Any

import httpx
import pytest

from meshdeform.client.requests import Call
from meshdeform.client.retries import Policy
from meshdeform.errors import ConflictError, LimitError, MeshdeformError, RequestError, UnavailableError
from tests.cases import each_case
from tests.unit.client.worlds import World, answer

POLICY = Policy(timeout_s=60.0, max_retries=4, chance=lambda: 1.0)
CALL = Call("POST", "/v1/jobs", headers={"Idempotency-Key": "k"})
OK = answer(200, "{}")


def refused(status: int, code: str = "x", **headers: str) -> Any:
    return answer(status, json.dumps({"code": code, "detail": "d", "advice": "a"}), **headers)


@each_case(
    "failure",
    [
        httpx.ConnectError("refused"),
        httpx.ReadError("cut"),
        httpx.ReadTimeout(""),
        httpx.RemoteProtocolError("disconnected"),
        httpx.PoolTimeout(""),
        *(refused(status) for status in (408, 429, 502, 503, 504)),
        refused(409, "idempotency_in_flight"),
    ],
)
def test_what_may_pass_is_tried_again_with_the_same_request(failure: Any) -> None:
    world = World(failure, failure, OK, policy=POLICY)
    assert world.answered(CALL).content == OK.content
    assert [(sent.method, sent.url.path, sent.headers["Idempotency-Key"]) for sent in world.requests] == [
        ("POST", "/v1/jobs", "k")
    ] * 3
    assert world.pauses == [0.25, 0.5]


@each_case(
    ("failure", "kind"),
    [
        (refused(409, "conflict"), ConflictError),
        (refused(422), RequestError),
        (refused(500, "internal"), MeshdeformError),
        (httpx.UnsupportedProtocol("ftp"), UnavailableError),
        (httpx.LocalProtocolError("bad header"), UnavailableError),
    ],
)
def test_what_will_not_pass_is_told_at_once(failure: Any, kind: type[MeshdeformError]) -> None:
    world = World(failure, policy=POLICY)
    with pytest.raises(kind):
        world.answered(CALL)
    assert world.pauses == []


def test_the_service_says_when() -> None:
    world = World(refused(429, retry_after="5"), refused(503, retry_after="0"), OK, policy=POLICY)
    world.answered(CALL)
    # Not before that, and not everybody at that moment.
    assert world.pauses == [5.0 + 0.25 * 0.25, 0.0 + 0.25 * 0.5]
    # A pause that goes past the time is not begun.
    late = World(refused(429, retry_after="61"), policy=POLICY)
    with pytest.raises(LimitError) as caught:
        late.answered(CALL)
    assert (caught.value.retry_after_s, late.pauses) == (61.0, [])


def test_a_key_that_a_dead_service_holds_is_waited_for() -> None:
    failures = [refused(409, "idempotency_in_flight", retry_after="1")] * 20
    assert World(*failures, OK, policy=POLICY).answered(CALL).content == OK.content
    with pytest.raises(ConflictError):
        World(*failures, policy=Policy(max_retries=0)).answered(CALL)


def test_time_is_counted_too(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def later(_: httpx.Request) -> Any:
        now[0] += 20.0
        return refused(503)

    world = World(*[later] * 9, policy=Policy(timeout_s=60.0, max_retries=100, chance=lambda: 1.0))
    with pytest.raises(UnavailableError):
        world.answered(CALL)
    assert len(world.requests) == 4  # the first, and those within 60 seconds of its failure


def test_pauses_grow_to_a_bound_and_differ_between_clients() -> None:
    failures = [httpx.ConnectError("refused")] * 9
    low = World(*failures, OK, policy=Policy(timeout_s=600.0, max_retries=9, chance=lambda: 0.0))
    high = World(*failures, OK, policy=Policy(timeout_s=600.0, max_retries=9, chance=lambda: 1.0))
    low.answered(CALL)
    high.answered(CALL)
    assert high.pauses == [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 8.0, 8.0]
    assert low.pauses == [pause / 2 for pause in high.pauses]
    for count in (0, 1, 3):
        world = World(*failures[: count + 1], policy=Policy(max_retries=count))
        with pytest.raises(UnavailableError):
            world.answered(CALL)
        assert len(world.pauses) == count


def test_what_is_gone_after_a_lost_answer_was_deleted() -> None:
    call = Call("DELETE", "/v1/jobs/x")
    assert World(httpx.ReadError("cut"), refused(404, "not_found"), policy=POLICY).answered(call).status == 404
    with pytest.raises(MeshdeformError):
        World(refused(503), refused(404, "not_found"), policy=POLICY).answered(call)
