"""Slots are shared between owners, whoever comes first and however many one asks for."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshdeform.errors import LimitError, UnavailableError
from service.http.limits import _MOST_BUCKETS, Buckets, FairSlots, Rate, RateLimiter


async def settle() -> None:
    """Let every task that can run do so."""
    for _ in range(10):
        await asyncio.sleep(0)


class Crowd:
    """Tasks that hold a slot until they are let go."""

    def __init__(self, slots: FairSlots) -> None:
        self.slots = slots
        self.granted: list[str] = []
        self.ends: dict[str, asyncio.Event] = {}
        self.tasks: dict[str, asyncio.Task[None]] = {}

    async def come(self, *names: str) -> None:
        for name in names:
            self.ends[name] = asyncio.Event()
            self.tasks[name] = asyncio.create_task(self._hold(name))
            await settle()

    async def go(self, name: str) -> None:
        self.ends[name].set()
        await settle()

    async def _hold(self, name: str) -> None:
        async with self.slots.slot(name[0]):
            self.granted.append(name)
            await self.ends[name].wait()


def test_who_looks_on_waits_a_moment_and_few_of_one_owner_do() -> None:
    async def story() -> None:
        slots = FairSlots(2, 1, wait_s=60, purpose="previews are being made")
        async with slots.slot("a"):
            with pytest.raises(LimitError) as late:
                async with slots.slot("a", soon_s=0.01, most=1):
                    pass
            assert late.value.extra["retry_after_s"] == 1

            async def wait() -> None:
                async with slots.slot("a", soon_s=60, most=1):
                    pass

            waiting = asyncio.create_task(wait())
            await settle()
            with pytest.raises(LimitError):
                async with slots.slot("a", soon_s=60, most=1):
                    pass
            async with slots.slot("b", soon_s=60, most=1):  # another owner has a place of its own
                pass
        await waiting

    asyncio.run(story())


def test_an_owner_never_takes_every_slot_and_owners_take_turns() -> None:
    async def story() -> None:
        crowd = Crowd(FairSlots(3, 2, wait_s=60, purpose="files are being checked"))
        await crowd.come("a1", "a2", "a3", "a4", "a5", "b1", "b2", "c1")
        assert crowd.granted == ["a1", "a2", "b1"], "a third slot is for another owner, who came later"
        await crowd.go("b1")
        assert crowd.granted[3:] == ["b2"], "a holds as many as it may"
        await crowd.go("a1")
        assert crowd.granted[4:] == ["a3"]
        await crowd.go("a2")
        assert crowd.granted[5:] == ["c1"], "turns, not the order in which they came"
        for name in ("a3", "b2", "c1"):
            await crowd.go(name)
        assert crowd.granted[6:] == ["a4", "a5"]

    asyncio.run(story())


def test_who_stops_waiting_takes_no_slot_along() -> None:
    async def story() -> None:
        slots = FairSlots(1, 1, wait_s=60, purpose="files are being checked")
        crowd = Crowd(slots)
        await crowd.come("a1", "a2", "b1")
        crowd.tasks["a2"].cancel()
        await settle()
        # Granted and cancelled in the same turn of the loop.
        crowd.ends["a1"].set()
        await asyncio.sleep(0)
        crowd.tasks["b1"].cancel()
        await settle()
        await crowd.come("c1")
        assert crowd.granted[-1] == "c1"
        await crowd.go("c1")
        assert not slots._waiting
        assert not slots._held

    asyncio.run(story())


def test_waiting_ends_with_an_error_that_says_why() -> None:
    async def story() -> None:
        slots = FairSlots(2, 1, wait_s=0.01, purpose="files are being received")
        async with slots.slot("ann"):
            with pytest.raises(UnavailableError, match="files are being received at the same time: 1 of yours, 1 alto"):
                async with slots.slot("ann"):
                    pass
            async with slots.slot("bob"):
                pass
        assert not slots._waiting

    asyncio.run(story())


# The bucket's arithmetic, with a clock of the test's own.


def test_a_burst_then_one_for_each_interval() -> None:
    assert [Rate.of(count).burst for count in (1, 5, 10, 60, 100, 600)] == [1, 5, 10, 10, 10, 60]
    buckets, rate = Buckets(), Rate(per_minute=60, burst=3)
    first = [buckets.take("key", rate, now=100.0) for _ in range(4)]
    assert [verdict.wait_s for verdict in first] == [0.0, 0.0, 0.0, pytest.approx(1.0)]
    assert [verdict.remaining for verdict in first] == [2, 1, 0, 0]
    assert [verdict.reset_s for verdict in first] == [1, 2, 3, 3]
    assert buckets.take("key", rate, now=100.9).wait_s == pytest.approx(0.1)
    assert buckets.take("key", rate, now=101.0).wait_s == 0.0
    assert buckets.take("key", rate, now=101.0).wait_s == pytest.approx(1.0)
    assert buckets.take("another", rate, now=101.0).wait_s == 0.0
    buckets.give_back("another", rate)
    assert [buckets.take("another", rate, now=101.0).remaining for _ in range(2)] == [2, 1]


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
