"""Share slots fairly between owners: a maximum for each, and turns between those who wait."""

from __future__ import annotations

from collections import Counter, OrderedDict, deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio

from meshdeform.errors import UnavailableError

__all__ = ["FairSlots"]


class FairSlots:
    """A number of slots on one event loop.

    Parameters
    ----------
    total : int
        Slots that may be held at the same time.
    per_owner : int
        Slots that one owner may hold. The others stay free for other owners.
    wait_s : float
        Seconds to wait for a slot.
    purpose : str
        What holds a slot, for the error: "files are being received".
    """

    def __init__(self, total: int, per_owner: int, *, wait_s: float, purpose: str) -> None:
        self.total, self.per_owner, self.wait_s = total, per_owner, wait_s
        self._purpose = purpose
        self._held: Counter[str] = Counter()
        self._waiting: OrderedDict[str, deque[anyio.Event]] = OrderedDict()

    @asynccontextmanager
    async def slot(self, owner_id: str) -> AsyncIterator[None]:
        """Hold a slot while the block runs, after waiting for a turn.

        Raises
        ------
        UnavailableError
            No slot became free in time.
        """
        await self._acquire(owner_id)
        try:
            yield
        finally:
            self._release(owner_id)

    async def _acquire(self, owner_id: str) -> None:
        turn = anyio.Event()
        self._waiting.setdefault(owner_id, deque()).append(turn)
        self._grant()
        try:
            with anyio.move_on_after(self.wait_s):
                await turn.wait()
                return
        except BaseException:
            self._leave(owner_id, turn)
            raise
        if not turn.is_set():
            self._leave(owner_id, turn)
            raise UnavailableError(
                f"Too many {self._purpose} at the same time: {self._held[owner_id]} of yours, "
                f"{self._held.total()} altogether.",
                advice="Try again in a moment.",
            )

    def _leave(self, owner_id: str, turn: anyio.Event) -> None:
        """Give up waiting, or give the slot back if it was granted in the same moment."""
        if turn.is_set():
            self._release(owner_id)
            return
        queue = self._waiting[owner_id]
        queue.remove(turn)
        if not queue:
            del self._waiting[owner_id]

    def _release(self, owner_id: str) -> None:
        self._held[owner_id] -= 1
        if not self._held[owner_id]:
            del self._held[owner_id]
        self._grant()

    def _grant(self) -> None:
        """Give free slots to those who wait, one owner after the other."""
        while self._held.total() < self.total:
            owner_id = next((each for each in self._waiting if self._held[each] < self.per_owner), None)
            if owner_id is None:
                return
            queue = self._waiting[owner_id]
            queue.popleft().set()
            self._held[owner_id] += 1
            if queue:
                self._waiting.move_to_end(owner_id)
            else:
                del self._waiting[owner_id]
