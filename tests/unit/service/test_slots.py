"""Slots are shared between owners, whoever comes first and however many one asks for."""

from __future__ import annotations

import asyncio

import pytest

from meshdeform.errors import UnavailableError
from service.http.limits import FairSlots


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
