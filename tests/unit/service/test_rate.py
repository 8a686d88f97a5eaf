"""The bucket's arithmetic, with a clock of the test's own."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.http.limits import _MOST_BUCKETS, Buckets, Rate, RateLimiter
from tests.cases import each_case


@each_case(("per_minute", "burst"), [(1, 1), (5, 5), (10, 10), (60, 10), (100, 10), (600, 60), (6000, 600)])
def test_a_tenth_may_come_at_once(per_minute: int, burst: int) -> None:
    assert Rate.of(per_minute).burst == burst


def test_a_burst_then_one_for_each_interval() -> None:
    buckets, rate = Buckets(), Rate(per_minute=60, burst=3)
    first = [buckets.take("key", rate, now=100.0) for _ in range(4)]
    assert [verdict.wait_s for verdict in first] == [0.0, 0.0, 0.0, pytest.approx(1.0)]
    assert [verdict.remaining for verdict in first] == [2, 1, 0, 0]
    assert [verdict.reset_s for verdict in first] == [1, 2, 3, 3]
    assert buckets.take("key", rate, now=100.9).wait_s == pytest.approx(0.1)
    assert buckets.take("key", rate, now=101.0).wait_s == 0.0
    assert buckets.take("key", rate, now=101.0).wait_s == pytest.approx(1.0)
    assert buckets.take("another", rate, now=101.0).wait_s == 0.0


@given(
    per_minute=st.integers(1, 1000),
    steps=st.lists(st.floats(0.0, 30.0), min_size=1, max_size=300),
)
def test_no_stretch_of_time_lets_more_in_than_the_burst_and_the_rate(per_minute: int, steps: list[float]) -> None:
    buckets, rate, now = Buckets(), Rate.of(per_minute), 0.0
    let_in = []
    for step in steps:
        now += step
        if not buckets.take("key", rate, now).wait_s:
            let_in.append(now)
    for first in range(len(let_in)):
        for last in range(first, min(first + 40, len(let_in))):
            allowed = rate.burst + (let_in[last] - let_in[first]) / rate.interval_s
            assert last - first + 1 <= allowed + 1e-3


def test_who_waits_as_long_as_told_gets_in() -> None:
    buckets, rate, now = Buckets(), Rate(per_minute=7, burst=2), 0.0
    for _ in range(50):
        verdict = buckets.take("key", rate, now)
        if verdict.wait_s:
            now += verdict.wait_s
            assert not buckets.take("key", rate, now).wait_s


def test_what_is_given_back_does_not_count() -> None:
    buckets, rate = Buckets(), Rate(per_minute=1, burst=1)
    assert not buckets.take("peer", rate, now=0.0).wait_s
    buckets.give_back("peer", rate)
    assert not buckets.take("peer", rate, now=0.0).wait_s
    assert buckets.take("peer", rate, now=0.0).wait_s


def test_an_attack_from_many_addresses_does_not_fill_the_memory() -> None:
    buckets, rate = Buckets(), Rate(per_minute=1, burst=1)
    for number in range(3 * _MOST_BUCKETS):
        buckets.take(str(number), rate, now=number / 1e6)
    assert len(buckets._empty_at) <= _MOST_BUCKETS
    assert buckets.take(str(3 * _MOST_BUCKETS - 1), rate, now=0.1).wait_s  # the newest is still known


def test_without_redis_the_limit_holds_in_this_process(redis_down: str) -> None:
    limiter = RateLimiter(redis_down, "test")
    assert [bool(limiter.take("key", 3).wait_s) for _ in range(4)] == [False, False, False, True]
    limiter.close()


@pytest.fixture
def redis_down() -> str:
    from tests.servers import free_port

    return f"redis://127.0.0.1:{free_port()}/0"
